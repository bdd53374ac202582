"""The datagrams of Kongsberg's .all files: those that are wanted, checked and unpacked; little endian.

Format: Kongsberg 160692, "EM Series Multibeam echo sounders, Datagram formats". Each has its size without these four
bytes, STX, its type, the model, date and time, a counter, a serial number, its content, ETX, and the sum of the bytes
between STX and ETX.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from sonarmap.kernels.errors import InputError

_SIZE = struct.Struct("<I")
_HEADER = struct.Struct("<BBHIIHH")  # STX, type, model, date, time [ms], counter, serial number
_STX, _ETX = 2, 3
_TAIL = 3  # ETX and the checksum
_LARGEST = 1 << 20  # bytes; datagrams come by UDP, at most 64 KiB each, and some are joined in the file
_SWATH = struct.Struct("<HHfHHfB3x")  # heading, speed of sound, depth, beams, valid ones, sampling rate, scanning
_SOUNDING = np.dtype(
    {"names": ["z", "y", "x", "detection", "cleaning"], "formats": ["<f4", "<f4", "<f4", "u1", "i1"],
     "offsets": [0, 4, 8, 16, 17], "itemsize": 20}
)  # fmt: skip
_POSITION = struct.Struct("<iiHHHHBB")  # latitude, longitude, quality, speed, course, heading, system, bytes of input
_MOTION = np.dtype([("after", "<u2"), ("status", "<u2"), ("roll", "<i2"), ("pitch", "<i2"), ("heave", "<i2"),
                    ("heading", "<u2")])  # fmt: skip
_ACTIVE = 0x80  # of a position's system
_ROLL_UNUSED = 0x02  # of an attitude's system
_INVALID = 0x80  # of a sounding's detection


@dataclass(frozen=True, slots=True)
class Datagram:
    """A datagram whose checksum fits."""

    kind: str
    model: int
    stamp: float  # [s, UTC]
    serial: int
    content: bytes


@dataclass(frozen=True, slots=True)
class Swath:
    """An XYZ 88 datagram.

    Attributes:
        heading: of the vessel [rad].
        sound_speed: at the transducer [m/s].
        depth: of the transmit transducer below the water's level [m].
        points: (n, 3) float64 [m], not rejected: forward, to port and up from the position's reference point and that
            transducer's depth.
        beams: soundings in all.
    """

    heading: float
    sound_speed: float
    depth: float
    points: np.ndarray
    beams: int


def datagrams_in(content: bytes, wanted: str) -> Iterator[Datagram | int]:
    """Datagrams of these types; and, where some bytes are no datagram, their number: it goes on at the next one."""
    start = 0
    while start < len(content):
        size = _size_at(content, start)
        if not size:
            following = _next(content, start + 1)
            yield following - start
            start = following
            continue
        datagram = _unpacked(content[start + 4 : start + size], wanted)
        if datagram is not None:
            yield datagram
        start += size


def swath_of(content: bytes) -> Swath:
    """An XYZ 88 datagram's. Raises InputError: it is shorter than its count of beams claims."""
    _require(content, _SWATH.size)
    heading, speed, depth, beams, _, _, _ = _SWATH.unpack_from(content)
    _require(content, _SWATH.size + beams * _SOUNDING.itemsize)
    rows = np.frombuffer(content, _SOUNDING, beams, _SWATH.size)
    # realtime cleaning marks what it rejects with negative numbers
    rows = rows[(rows["detection"] & _INVALID == 0) & (rows["cleaning"] >= 0)]
    points = np.column_stack([rows["x"], -rows["y"], -rows["z"]]).astype(np.float64)
    return Swath(np.radians(heading / 100), speed / 10, depth, points, beams)


def position_of(content: bytes) -> tuple[float, float, int] | None:
    """Latitude, longitude [deg] and the number of the position system, 1 to 3; None if it is not the active one."""
    _require(content, _POSITION.size)
    latitude, longitude, _, _, _, _, system, _ = _POSITION.unpack_from(content)
    return (latitude / 2e7, longitude / 1e7, system & 3) if system & _ACTIVE else None


def motion_of(content: bytes) -> np.ndarray | None:
    """(n, 3) float64: seconds after the datagram's stamp, roll and pitch [deg]; None if it is not of the active motion
    sensor."""
    _require(content, 2)
    (count,) = struct.unpack_from("<H", content)
    _require(content, 2 + count * _MOTION.itemsize + 1)
    if content[2 + count * _MOTION.itemsize] & _ROLL_UNUSED:
        return None
    rows = np.frombuffer(content, _MOTION, count, 2)
    return np.column_stack([rows["after"] / 1000, rows["roll"] / 100, rows["pitch"] / 100])


def installation_of(content: bytes) -> dict[str, str]:
    """The installation parameters by their names, as S1X; and the serial number of a second head as "second"."""
    _require(content, 2)
    words = (word.partition("=") for word in content[2:].decode("ascii", "replace").strip("\0 \r\n").split(","))
    found = {key.strip(): value.strip() for key, separator, value in words if separator}
    return found | {"second": str(struct.unpack_from("<H", content)[0])}


def _require(content: bytes, size: int) -> None:
    if size > len(content):
        raise InputError(f"has {len(content):,} bytes of content; wanted at least {size:,}")


def _size_at(content: bytes, start: int) -> int:
    """Of a whole datagram that begins there; 0 if none does."""
    if start + 4 + _HEADER.size > len(content) or content[start + 4] != _STX:
        return 0
    size = _SIZE.unpack_from(content, start)[0] + 4
    end = start + size
    if not 4 + _HEADER.size + _TAIL <= size <= _LARGEST or end > len(content) or content[end - _TAIL] != _ETX:
        return 0
    total = int(np.frombuffer(content, np.uint8, size - 5 - _TAIL, start + 5).sum(dtype=np.uint64)) & 0xFFFF
    return size if total == int.from_bytes(content[end - 2 : end], "little") else 0


def _next(content: bytes, start: int) -> int:
    """Where the next datagram begins, from a byte on; the end if there is none."""
    while (place := content.find(b"\x02", start + 4)) >= 0:
        start = place - 4
        if _size_at(content, start):
            return start
        start += 1
    return len(content)


def _unpacked(datagram: bytes, wanted: str) -> Datagram | None:
    _, kind, model, date, milliseconds, _, serial = _HEADER.unpack_from(datagram)
    if chr(kind) not in wanted:
        return None
    try:
        day = datetime(date // 10000, date // 100 % 100, date % 100, tzinfo=UTC).timestamp()
    except ValueError:
        day = float("nan")
    return Datagram(chr(kind), model, day + milliseconds / 1000, serial, datagram[_HEADER.size : -_TAIL])
