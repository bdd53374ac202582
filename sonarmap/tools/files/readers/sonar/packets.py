"""Packets of a recording in wlsonar's Range Image Protocol, read one by one; damaged ones are skipped."""

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from sonarmap.tools.files.readers.clouds.rows import shown
from sonarmap.tools.files.user_file import unreadable

MAGICS = (b"RIP1", b"RIP2")
LARGEST_PACKET = 1 << 18  # bytes; four times the largest UDP datagram, in which the sonar sends it
LEAST_PACKET = 12  # bytes; magic, length and checksum, 4 each

_MARK = b"RIP"
_CHUNK = 1 << 20  # bytes that are read at a time
_SEARCHED = 1 << 16  # bytes that are searched at a time for the next packet


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet with a right length and checksum: its number from 1, its first byte in the file, and all its bytes."""

    number: int
    start: int
    content: bytes


@dataclass(slots=True)
class Damage:
    """The parts of a recording that could not be read."""

    packets: int = 0  # damaged packets; a run of bytes that are no packet counts as one
    size: int = 0  # of all of them [bytes]
    first: str = ""  # position and fault of the first one, in words
    cut: int = 0  # size of a truncated packet at the end [bytes]

    def add(self, number: int, start: int, size: int, reason: str, is_cut: bool = False) -> None:
        """Count a damaged packet, or a run of bytes that are none; `is_cut`: a packet truncated by the file's end."""
        if is_cut:
            self.cut = size
        else:
            self.packets += 1
            self.size += size
        self.first = self.first or f"packet {number} at byte {start:,} {reason}"


def no_more() -> bool:
    return False


def packets_in(path: Path, damage: Damage, more: Callable[[], bool] = no_more, start: int = 0) -> Iterator[Packet]:
    """Every packet with a right checksum; a few MB of the file are in memory at a time. Bytes that are no packet are
    added to `damage`, and reading continues at the next packet. `more` is called at the file's end; it waits for a
    growing file, and returns whether to read again. `start`: the byte at which reading begins."""
    with unreadable(), path.open("rb", buffering=0) as file:
        file.seek(start)
        yield from _packets(_Window(file, more, start), damage, start)


class _Window:
    """Bytes of a file that is read forward only."""

    def __init__(self, file: BinaryIO, more: Callable[[], bool], start: int) -> None:
        self._file, self._more = file, more
        self._held, self._start = b"", start

    def bytes_at(self, start: int, count: int) -> bytes:
        """`count` bytes from `start` on; fewer at the end of the file."""
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
    """The packet that begins at `start`; empty if none does."""
    header = window.bytes_at(start, 8)
    if header[:4] not in MAGICS or not LEAST_PACKET <= (size := _size_in(header)) <= LARGEST_PACKET:
        return b""
    content = window.bytes_at(start, size)
    return content if len(content) == size and _checksum_fits(content) else b""


def fault_of(datagram: bytes) -> str:
    """Why a datagram is not one whole packet, in words; "" if it is. `datagram`: begins with one of MAGICS."""
    size = _size_in(datagram)
    if size != len(datagram) or size < LEAST_PACKET:
        return f"claims {size:,} bytes and has {len(datagram):,}"
    return "" if _checksum_fits(datagram) else "has a wrong checksum"


def _checksum_fits(packet: bytes) -> bool:
    return zlib.crc32(memoryview(packet)[:-4]) == int.from_bytes(packet[-4:], "little")


def _size_in(header: bytes) -> int:
    """The size that a packet claims, behind its magic."""
    return int.from_bytes(header[4:8], "little")


def _fault_at(window: _Window, start: int) -> tuple[str, bool]:
    """Why no packet begins at `start`, in words, and whether the rest of one may be missing."""
    header = window.bytes_at(start, 8)
    if len(header) < 8 or header[:4] not in MAGICS:
        return f"begins with {shown(header)}, wanted RIP2 and a length", len(header) < 8
    claimed = _size_in(header)
    rest = len(window.bytes_at(start, min(claimed, LARGEST_PACKET)))
    if claimed > rest or claimed < LEAST_PACKET:
        reason = f"claims {claimed:,} bytes, wanted at least {LEAST_PACKET} and no more than the {rest:,} that follow"
        return reason, rest < claimed <= LARGEST_PACKET
    return "has a wrong checksum", False


def _next_packet(window: _Window, start: int) -> tuple[int | None, int]:
    """First byte of the next packet, None if there is none; and the end of the bytes that are skipped."""
    while len(piece := window.bytes_at(start, _SEARCHED)) >= LEAST_PACKET:
        place = piece.find(_MARK)
        if place < 0:
            start += len(piece) - len(_MARK) + 1
        elif _packet_at(window, start + place):
            return start + place, start + place
        else:
            start += place + 1
    return None, start + len(piece)
