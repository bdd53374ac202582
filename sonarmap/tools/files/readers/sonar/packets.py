"""The packets of a recording (wlsonar's Range Image Protocol), one by one; what is damaged is skipped."""

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from sonarmap.tools.files.readers.clouds.rows import shown
from sonarmap.tools.files.user_file import unreadable

MAGICS = (b"RIP1", b"RIP2")
LARGEST_PACKET = 1 << 18  # bytes; four times what a datagram, in which the sonar sends it, can hold
LEAST_PACKET = 12  # magic, length and checksum, 4 bytes each

_MARK = b"RIP"
_CHUNK = 1 << 20  # bytes that are read at a time
_SEARCHED = 1 << 16  # bytes that are looked through at a time for the next packet


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet whose length and checksum fit: its number from 1, its first byte in the file, and all of its bytes."""

    number: int
    start: int
    content: bytes


@dataclass(slots=True)
class Damage:
    """What of a recording could not be read."""

    packets: int = 0  # damaged packets; bytes in a row that are no packet count as one
    size: int = 0  # of all of them [bytes]
    first: str = ""  # where the first one is and what is wrong with it, in words
    cut: int = 0  # size of a packet at the end whose rest is missing [bytes]

    def add(self, number: int, start: int, size: int, reason: str, is_cut: bool = False) -> None:
        """Count a packet, or bytes that are none; or the recording ends within one."""
        if is_cut:
            self.cut = size
        else:
            self.packets += 1
            self.size += size
        self.first = self.first or f"packet {number} at byte {start:,} {reason}"


def no_more() -> bool:
    return False


def packets_in(path: Path, damage: Damage, more: Callable[[], bool] = no_more, start: int = 0) -> Iterator[Packet]:
    """Every packet with a right checksum, of a file of which a few MB are in memory at a time; after `damage`, to which
    bytes that are no packet are added, reading goes on at the next one. `more` is called at the file's end, and says
    whether to try again: of a file that grows it waits. `start`: the byte at which reading begins."""
    with unreadable(), path.open("rb", buffering=0) as file:
        file.seek(start)
        yield from _packets(_Window(file, more, start), damage, start)


class _Window:
    """Bytes of a file, for someone who only goes forward."""

    def __init__(self, file: BinaryIO, more: Callable[[], bool], start: int) -> None:
        self._file, self._more = file, more
        self._held, self._start = b"", start

    def bytes_at(self, start: int, count: int) -> bytes:
        """So many bytes; fewer at the end of the file."""
        while start + count > self._start + len(self._held):
            read = self._file.read(_CHUNK)
            if not read and self._more():
                continue
            if not read:
                break
            self._held, self._start = self._held[start - self._start :] + read, start
        return self._held[start - self._start : start - self._start + count]


def _packets(window: _Window, damage: Damage, start: int) -> Iterator[Packet]:
    number = 0
    while window.bytes_at(start, 1):
        number += 1
        content = _packet_at(window, start)
        if content:
            yield Packet(number, start, content)
            start += len(content)
            continue
        reason, is_cut = _fault_at(window, start)
        following, end = _next_packet(window, start + 1)
        damage.add(number, start, end - start, reason, is_cut and following is None)
        start = end


def _packet_at(window: _Window, start: int) -> bytes:
    """The packet that begins there; nothing if none does."""
    length = _length(window.bytes_at(start, 8))
    content = window.bytes_at(start, length) if length else b""
    return content if content and len(content) == length and _checksum_fits(content) else b""


def fault_of(datagram: bytes) -> str:
    """Why a datagram is not one whole packet, in words; nothing if it is. `datagram`: begins with one of MAGICS."""
    length = _length(datagram[:8])
    if length != len(datagram):
        return f"claims {int.from_bytes(datagram[4:8], 'little'):,} bytes and has {len(datagram):,}"
    return "" if _checksum_fits(datagram) else "has a wrong checksum"


def _checksum_fits(packet: bytes) -> bool:
    (checksum,) = struct.unpack_from("<I", packet, len(packet) - 4)
    return zlib.crc32(memoryview(packet)[:-4]) == checksum


def _length(header: bytes) -> int:
    """Of the packet with this magic and length, 0 for one that cannot be."""
    if len(header) < 8 or header[:4] not in MAGICS:
        return 0
    (length,) = struct.unpack_from("<I", header, 4)
    return length if LEAST_PACKET <= length <= LARGEST_PACKET else 0


def _fault_at(window: _Window, start: int) -> tuple[str, bool]:
    """Why no packet begins there, in words, and whether the rest of one can be missing."""
    header = window.bytes_at(start, 8)
    if len(header) < 8 or header[:4] not in MAGICS:
        return f"begins with {shown(header)}, wanted RIP2 and a length", len(header) < 8
    (claimed,) = struct.unpack_from("<I", header, 4)
    left = len(window.bytes_at(start, min(claimed, LARGEST_PACKET)))
    if claimed > left or claimed < LEAST_PACKET:
        reason = f"claims {claimed:,} bytes, wanted at least {LEAST_PACKET} and no more than the {left:,} that follow"
        return reason, left < claimed <= LARGEST_PACKET
    return "has a wrong checksum", False


def _next_packet(window: _Window, start: int) -> tuple[int | None, int]:
    """Where the next packet begins, None if there is none; and where what is skipped ends."""
    while len(piece := window.bytes_at(start, _SEARCHED)) >= LEAST_PACKET:
        place = piece.find(_MARK)
        if place < 0:
            start += len(piece) - len(_MARK) + 1
        elif _packet_at(window, start + place):
            return start + place, start + place
        else:
            start += place + 1
    return None, start + len(piece)
