"""The datagrams of Kongsberg's .all files, and of what MB-System writes of them, checked; in either byte order.

Format: Kongsberg 160692, "EM Series Multibeam echo sounders, Datagram formats". Each has its size without these four
bytes, STX, its type, the model, date and time, a counter, a serial number, its content, ETX, and the sum of the bytes
between STX and ETX.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal

import numpy as np

from sonarmap.kernels.errors import InputError

_ORDERS: tuple[Literal["<"], Literal[">"]] = ("<", ">")
_HEADER = "BBHIIHH"  # STX, type, model, date, time [ms], counter, serial number
_HEAD = 4 + struct.calcsize("<" + _HEADER)  # bytes before the content
_STX, _ETX = 2, 3
_TAIL = 3  # ETX and the checksum
_LARGEST = 1 << 20  # bytes; datagrams come by UDP, at most 64 KiB each, and some are joined in the file
_SAMPLE = 50  # datagrams by which it is decided whether a file has checksums


@dataclass(frozen=True, slots=True)
class Datagram:
    """One datagram; the stamp is NaN where its date is none."""

    kind: str
    model: int
    stamp: float  # [s, UTC]
    serial: int
    order: Literal["<", ">"]  # of its numbers
    content: bytes

    def rows(self, layout: np.dtype, start: int = 0, count: int = 1) -> np.ndarray:
        """(count,) of this layout, from a byte of the content on. Raises InputError: it is too short for these."""
        end = start + count * layout.itemsize
        if end > len(self.content):
            raise InputError(f"has {len(self.content):,} bytes of content; wanted at least {end:,}")
        return np.frombuffer(self.content, layout.newbyteorder(self.order), count, start)


def layout_of(words: str) -> np.dtype:
    """Of fields as "name:type name:type", without gaps."""
    return np.dtype([tuple(word.split(":")) for word in words.split()])


def datagrams_in(content: bytes, wanted: str) -> Iterator[Datagram | int]:
    """Datagrams of these types; and, where some bytes are no datagram, their number: it goes on at the next one."""
    checked, start = _has_checksums(content), 0
    while start < len(content):
        size = _size_at(content, start)
        if not size or (checked and not _is_sound(content, start, size, wanted)):
            following = _next(content, start + 1, checked)
            yield following - start
            start = following
            continue
        if chr(content[start + 5]) in wanted:
            yield _unpacked(content[start : start + size])
        start += size


def _has_checksums(content: bytes) -> bool:
    """Whether more than a few of the first datagrams have one that fits: some software writes none."""
    start, fits = 0, list[bool]()
    while len(fits) < _SAMPLE and (size := _size_at(content, start)):
        fits.append(_fits(content, start, size))
        start += size
    return 4 * sum(fits) >= len(fits)


def _size_at(content: bytes, start: int) -> int:
    """Of what has the frame of a datagram there; 0 if nothing has. Its size may be in another order than the rest."""
    if start + _HEAD > len(content) or content[start + 4] != _STX:
        return 0
    for order in _ORDERS:
        size = struct.unpack_from(order + "I", content, start)[0] + 4
        end = start + size
        if _HEAD + _TAIL <= size <= _LARGEST and end <= len(content) and content[end - _TAIL] == _ETX:
            return size
    return 0


def _is_sound(content: bytes, start: int, size: int, wanted: str) -> bool:
    """Whether the checksum fits; of what is not wanted it is enough that another datagram follows, or the end."""
    end = start + size
    passed_over = chr(content[start + 5]) not in wanted and (end == len(content) or _size_at(content, end) > 0)
    return passed_over or _fits(content, start, size)


def _fits(content: bytes, start: int, size: int) -> bool:
    total = int(np.frombuffer(content, np.uint8, size - 5 - _TAIL, start + 5).sum(dtype=np.uint64)) & 0xFFFF
    return content[start + size - 2 : start + size] in (total.to_bytes(2, "little"), total.to_bytes(2, "big"))


def _next(content: bytes, start: int, checked: bool) -> int:
    """Where the next datagram begins, from a byte on; the end if there is none."""
    while (place := content.find(b"\x02", start + 4)) >= 0:
        start = place - 4
        if (size := _size_at(content, start)) and (not checked or _fits(content, start, size)):
            return start
        start += 1
    return len(content)


def _unpacked(datagram: bytes) -> Datagram:
    for order in _ORDERS:
        _, kind, model, date, milliseconds, _, serial = struct.unpack_from(order + _HEADER, datagram, 4)
        if (day := _day(date)) is not None and milliseconds <= 86_400_000:
            return Datagram(chr(kind), model, day + milliseconds / 1000, serial, order, datagram[_HEAD:-_TAIL])
    return Datagram(chr(datagram[5]), 0, np.nan, 0, "<", datagram[_HEAD:-_TAIL])


def _day(date: int) -> float | None:
    """The stamp of a day as 20180102 [s, UTC]; None if it is none."""
    try:
        return datetime(date // 10000, date // 100 % 100, date % 100, tzinfo=UTC).timestamp()
    except ValueError:
        return None
