"""Datagrams of Kongsberg's .all files and of MB-System's versions of them, and their soundings.

Format: Kongsberg 160692, "EM Series Multibeam echo sounders, Datagram formats". A datagram has its size without these
four bytes, STX, its type, the model, date and time, a counter, a serial number, its content, ETX, and the sum of the
bytes between STX and ETX, in either byte order. Soundings are in XYZ 88 (X) or the older depths (D), which use units
given in each ping, and list only valid beams. MB-System's formats 57 and 59 add positions of pings and flags of beams.
"""

import struct
from collections.abc import Callable, Iterable, Iterator
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
_SAMPLE = 50  # datagrams that show whether a file has checksums
_D_HEAD = " heading:u2 sound_speed:u2 depth:u2 most:u1 beams:u1 z_unit:u1 xy_unit:u1 rate:i2 "
_D = " z:i2 y:i2 x:i2 depression:i2 azimuth:u2 range:u2 quality:u1 window:u1 "
_X_HEAD = " sound_speed:u2 depth:f4 beams:u2 valid:u2 rate:f4 scanning:u1 spare:V3 "
_X = " z:f4 y:f4 x:f4 window:u2 quality:u1 adjustment:i1 detection:u1 cleaning:i1 strength:i2 "
_FIX, _RAY = " latitude:i4 longitude:i4 ", " depression:f4 azimuth:f4 range:f4 "
_MB_HEAD = _FIX + "heading:u2 heave:i2 roll:i2 pitch:i2 speed:u2" + _X_HEAD
_IN_UNITS, _BY_MB_SYSTEM = "D\xe1", "\xe1\xe3\xe5"
# Models whose depths in D are unsigned; the last are MB-System's for the EM12, 121, 100, 1000
_DEEP = {120, 300, *range(9901, 9906)}
# EM3000D: the field of the sampling rate is the depth of the second head, with beams from 128 on, below the first [cm].
# In the model 3002 it is not.
_TWO_HEADS, _SECOND = range(3003, 3009), 128
_MULTIPLIERS = range(-1, 18)  # valid ones, of 655.36 m, which are added to the transducer's depth in D
_INVALID, _UNDETECTED = 0x80, 0x84  # bit of a sounding's detection; its value without one, with bits of no meaning set
_DETECTION = 0x8F  # bits of the detection that say so
_NULL, _FLAGGED = 1, 2  # bits of MB-System's flag


@dataclass(frozen=True, slots=True)
class Datagram:
    """One datagram; its stamp is NaN if its date is invalid."""

    kind: str
    model: int
    stamp: float  # [s, UTC]
    serial: int
    order: Literal["<", ">"]  # of its numbers
    content: bytes

    def rows(self, layout: np.dtype, start: int = 0, count: int = 1) -> np.ndarray:
        """(count,) rows of `layout` from byte `start` of the content on."""
        end = start + count * layout.itemsize
        if end > len(self.content):
            raise InputError(f"has {len(self.content):,} bytes of content; wanted at least {end:,}")
        return np.frombuffer(self.content, layout.newbyteorder(self.order), count, start)


def layout_of(words: str) -> np.dtype:
    """The dtype of fields "name:type name:type", without gaps."""
    return np.dtype([tuple(word.split(":")) for word in words.split()])


def take_all(datagrams: Iterable[Datagram | int], take: Callable[[Datagram], None]) -> tuple[int, list[str]]:
    """Call `take` with every datagram; return the number of bytes that are none, and the damaged ones' faults."""
    skipped, faults = 0, list[str]()
    for datagram in datagrams:
        if isinstance(datagram, int):
            skipped += datagram
            continue
        try:
            take(datagram)
        except InputError as error:
            faults.append(f"a datagram {datagram.kind} {error}")
    return skipped, faults


def datagrams_in(content: bytes, wanted: str) -> Iterator[Datagram | int]:
    """Datagrams of the types `wanted`; for bytes that are no datagram, their number."""
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
    """Whether a quarter of the first datagrams have a right checksum: some software writes none."""
    start, fits = 0, list[bool]()
    while len(fits) < _SAMPLE and (size := _size_at(content, start)):
        fits.append(_fits(content, start, size))
        start += size
    return 4 * sum(fits) >= len(fits)


def _size_at(content: bytes, start: int) -> int:
    """Size of the datagram at `start`; 0 if there is none. It may have another byte order than the rest."""
    if start + _HEAD > len(content) or content[start + 4] != _STX:
        return 0
    for order in _ORDERS:
        size = struct.unpack_from(order + "I", content, start)[0] + 4
        end = start + size
        if _HEAD + _TAIL <= size <= _LARGEST and end <= len(content) and content[end - _TAIL] == _ETX:
            return size
    return 0


def _is_sound(content: bytes, start: int, size: int, wanted: str) -> bool:
    """Whether the checksum is right, or the type is not wanted and another datagram, or the end, follows."""
    end = start + size
    skipped = chr(content[start + 5]) not in wanted and (end == len(content) or _size_at(content, end) > 0)
    return skipped or _fits(content, start, size)


def _fits(content: bytes, start: int, size: int) -> bool:
    total = int(np.frombuffer(content, np.uint8, size - 5 - _TAIL, start + 5).sum(dtype=np.uint64)) & 0xFFFF
    return content[start + size - 2 : start + size] in (total.to_bytes(2, "little"), total.to_bytes(2, "big"))


def _next(content: bytes, start: int, checked: bool) -> int:
    """First byte of the next datagram, from `start` on; the end of the content if there is none."""
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
    """The stamp of a date as 20180102 [s, UTC]; None if it is invalid."""
    try:
        return datetime(date // 10000, date // 100 % 100, date % 100, tzinfo=UTC).timestamp()
    except ValueError:
        return None


# {type: layout of a datagram's head, and of each of its beams}
SWATHS = {
    kind: (layout_of(head), layout_of(beam))
    for kind, head, beam in (
        ("D", _D_HEAD, _D + "strength:i1 number:u1"),
        ("X", "heading:u2" + _X_HEAD, _X),
        ("\xe1", _FIX + "speed:u2" + _D_HEAD, _D + "strength:i2 number:u1 flag:u1"),
        ("\xe3", _MB_HEAD, _X + _RAY + "flag:u1 spare:u1"),
        ("\xe5", _MB_HEAD, _X + _RAY + "heave:f4 flag:u1 spare:u1"),
    )
}


@dataclass(frozen=True, slots=True)
class Swath:
    """One ping."""

    heading: float  # of the vessel [rad]
    sound_speed: float  # at the transducer [m/s]
    depth: float  # of the transmit transducer below the water's level [m]
    fix: tuple[float, float]  # latitude, longitude [deg] by MB-System, maybe its value for unknown; else NaN
    # (n, 3) float64 [m]: forward, port, up from the position's reference point, at `depth`; NaN without a detection
    points: np.ndarray
    flagged: np.ndarray  # (n,) bool, whether a sounding is rejected


def swath_of(datagram: Datagram) -> Swath:
    """The ping in a datagram of a type in SWATHS."""
    head_layout, layout = SWATHS[datagram.kind]
    head = datagram.rows(head_layout)[0]
    rows = datagram.rows(layout, head_layout.itemsize, int(head["beams"]))
    points, depth = np.column_stack([rows[axis].astype(np.float64) for axis in "xyz"]), float(head["depth"])
    flagged = np.zeros(len(rows), bool)
    if datagram.kind in _IN_UNITS:
        depth = _in_meters(datagram, head, rows, points)
    if datagram.kind in _BY_MB_SYSTEM:
        points[rows["flag"] & _NULL > 0] = np.nan
        flagged = rows["flag"] & _FLAGGED > 0
    elif datagram.kind == "X":
        points[rows["detection"] & _DETECTION == _UNDETECTED] = np.nan
        # realtime cleaning marks rejected soundings with negative numbers
        flagged = (rows["detection"] & _INVALID > 0) | (rows["cleaning"] < 0)
    fix = (head["latitude"] / 2e7, head["longitude"] / 1e7) if datagram.kind in _BY_MB_SYSTEM else (np.nan, np.nan)
    heading = np.radians(head["heading"] / 100) if head["heading"] <= 36000 else np.nan
    return Swath(heading, head["sound_speed"] / 10, depth, fix, points * [1, -1, -1], flagged)


def _in_meters(datagram: Datagram, head: np.void, rows: np.ndarray, points: np.ndarray) -> float:
    """Convert points of a D datagram to meters, in place, invalid ones to NaN; return the transducer's depth [m]."""
    if not (head["z_unit"] and head["xy_unit"]):
        raise InputError("has units of 0 cm")
    deep = datagram.model in _DEEP
    if deep:
        points[:, 2] %= 1 << 16
    valid = (points[:, 2] != 0) & (points[:, 2] != (0xFFFF if deep else 0x7FFF)) & (points[:, :2] != 0x7FFF).all(axis=1)
    points *= np.array([head["xy_unit"], head["xy_unit"], head["z_unit"]]) / 100
    points[~valid] = np.nan
    if datagram.model in _TWO_HEADS:
        points[rows["number"] >= _SECOND, 2] += head["rate"] / 100
    multiplier = int(datagram.rows(np.dtype("i1"), head.itemsize + rows.nbytes)[0])
    return head["depth"] / 100 + 655.36 * multiplier * (multiplier in _MULTIPLIERS)
