"""R2Sonic's bathymetry packet BTH0: ranges and angles of one ping. Big endian, in sections of a name and a size.

Layout: R2Sonic's operation manual, "Bathymetry data format 0". Angles are those of the array, from its center line,
the first one on the port side, ascending.
"""

import struct
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError

MAGIC = b"BTH0"
_PACKET = struct.Struct(">4sII")  # name, size, stream
_SECTION = struct.Struct(">2sH")  # name, size with these four bytes
_H0 = np.dtype(
    {"names": ["model", "seconds", "nanoseconds", "sound_speed", "count"],
     "formats": ["S12", ">u4", ">u4", ">f4", ">u2"], "offsets": [0, 24, 28, 40, 110]}
)  # fmt: skip
_RANGES, _STEPS = 4, 32  # where in R0 and A2, after their names and sizes, these stand
_DETECTED, _PASSED = 0b1100, 0b0011  # of the four flags of a point: phase or magnitude; brightness and colinearity


@dataclass(frozen=True, slots=True)
class Ranges:
    """What the echo sounder measured in one ping.

    Attributes:
        stamp: [s, UTC]; 0 where the echo sounder has no clock.
        model: as the echo sounder calls itself.
        sound_speed: at the transducer [m/s].
        points: (n, 3) float64 [m] in the frame of the array: x forward, y port, z up.
        flags: (n,) uint8, four flags each; None where the packet has none.
        has_range: (n,) bool, where there is a range.
    """

    stamp: float
    model: str
    sound_speed: float
    points: np.ndarray
    flags: np.ndarray | None
    has_range: np.ndarray


def ranges_of(packet: bytes) -> Ranges:
    """What a packet says. Raises InputError: it is not whole."""
    sections = _sections(packet)
    if not {b"H0", b"R0"} <= sections.keys() or not sections.keys() & {b"A0", b"A2"}:
        raise InputError(f"has sections {b' '.join(sections).decode('ascii', 'replace')}; wanted H0, R0 and A0 or A2")
    header = np.frombuffer(_part(sections[b"H0"], 0, _H0.itemsize), _H0)[0]
    speed, count = float(header["sound_speed"]), int(header["count"])
    if not 1300 < speed < 1700:
        raise InputError(f"says a speed of sound of {speed:g} m/s; wanted that of water")
    times = _integers(sections[b"R0"], _RANGES, count) * _float(sections[b"R0"], 0)  # two-way [s]
    ranges, angles = times * (speed / 2), _angles(sections, count)
    points = np.column_stack([np.zeros(count), -ranges * np.sin(angles), -ranges * np.cos(angles)])
    stamp, model = header["seconds"] + header["nanoseconds"] * 1e-9, header["model"].rstrip().decode("ascii", "replace")
    return Ranges(stamp, model, speed, points, _flags(sections.get(b"Q0"), count), ranges > 0)


def rejected(flags: np.ndarray, has_checks: bool) -> np.ndarray:
    """(n,) bool, which points the echo sounder rejects. `has_checks`: whether this recording uses the two flags for
    brightness and colinearity, which were reserved once and then are never set."""
    undetected = (flags & _DETECTED) == 0
    return undetected | ((flags & _PASSED) != _PASSED) if has_checks else undetected


def uses_checks(flags: np.ndarray) -> bool:
    """Whether any point passed a check."""
    return bool((flags & _PASSED).any())


def _sections(packet: bytes) -> dict[bytes, bytes]:
    """The content of each section, without its name and size."""
    if len(packet) < _PACKET.size or packet[:4] != MAGIC:
        raise InputError("does not begin with BTH0")
    size, found, start = min(_PACKET.unpack_from(packet)[1], len(packet)), dict[bytes, bytes](), _PACKET.size
    while start + _SECTION.size <= size:
        name, length = _SECTION.unpack_from(packet, start)
        if length < _SECTION.size or start + length > size:
            break
        found.setdefault(name, packet[start + _SECTION.size : start + length])
        start += length
    return found


def _angles(sections: dict[bytes, bytes], count: int) -> np.ndarray:
    """(n,) [rad] from the array's center line, positive to starboard; checked to be less than a half turn."""
    if b"A0" in sections:
        angles = np.linspace(_float(sections[b"A0"], 0), _float(sections[b"A0"], 4), count)
    else:
        steps = _integers(sections[b"A2"], _STEPS, count)
        angles = _float(sections[b"A2"], 0) + np.cumsum(steps) * _float(sections[b"A2"], 4)
    if not (np.abs(angles) < np.pi).all():
        raise InputError("has angles beyond a half turn")
    return angles


def _flags(section: bytes | None, count: int) -> np.ndarray | None:
    """(n,) uint8, four bits each, the first point in the higher ones."""
    if section is None or 2 * len(section) < count:
        return None
    packed = np.frombuffer(section, np.uint8, (count + 1) // 2)
    return np.column_stack([packed >> 4, packed & 15]).ravel()[:count]


def _integers(section: bytes, start: int, count: int) -> np.ndarray:
    """(n,) float64 of as many 16-bit ones."""
    return np.frombuffer(_part(section, start, 2 * count), ">u2").astype(np.float64)


def _float(section: bytes, start: int) -> float:
    return struct.unpack(">f", _part(section, start, 4))[0]


def _part(section: bytes, start: int, size: int) -> bytes:
    """So many bytes of a section, however many its count claims."""
    if start + size > len(section):
        raise InputError(f"has a section of {len(section):,} bytes; wanted at least {start + size:,}")
    return section[start : start + size]
