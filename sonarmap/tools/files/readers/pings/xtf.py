"""Reader of XTF, the eXtended Triton Format, with R2Sonic's packets of ranges and angles (type 65, by QINSy).

A ping is a header of 256 bytes (time, position and attitude of the sensor) and a packet BTH0. Position and heave are
those of the transducer, as their names (Sensor...) say: in a real harbor survey soundings then agree to 1.8 cm, and to
3.6 cm if the offsets of the channel, (5.3, 1.2) m, are added. So only the channel's angles are applied.

BTH0, ranges and angles of one ping, is big endian, in sections with a name and a size. Layout: R2Sonic's operation
manual, "Bathymetry data format 0". Angles are relative to the array's center line, ascending from the port side.
"""

import struct
from collections import Counter
from collections.abc import Iterator
from ctypes import sizeof
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import R_level_vehicle_of
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.pings.recorded import RecordedLine, assembled, between, damage
from sonarmap.tools.files.user_file import read_content

MAGIC = b"BTH0"
_PACKET = struct.Struct(">4sII")  # name, size, stream
_SECTION = struct.Struct(">2sH")  # name, size with these four bytes
_H0 = np.dtype(
    {"names": ["model", "seconds", "nanoseconds", "sound_speed", "count"],
     "formats": ["S12", ">u4", ">u4", ">f4", ">u2"], "offsets": [0, 24, 28, 40, 110]}
)  # fmt: skip
_RANGES, _STEPS = 4, 32  # offsets of the ranges in R0 and of the angle steps in A2, after name and size
_DETECTED, _PASSED = 0b1100, 0b0011  # flags of a point: phase or magnitude; brightness and colinearity
_MAGIC, _START = b"\xce\xfa", 14  # first bytes of a packet; size of its header, which ends with the packet's size
_R2SONIC, _TRITON, _ATTITUDE = 65, 68, 3  # types of packets: R2Sonic's by QINSy, and by Triton if they hold BTH0
_NAVIGATION, _RAW_BYTES = 107, 64  # type of raw positions; size of these and of attitudes [bytes]
_FILE_HEADER, _PING_HEADER = 1024, 256  # [bytes]
_CHANNELS = 6  # described by the first file header; every six more take another header
_LARGEST = 1 << 24  # [bytes], of a packet
_DEGREES = 3  # value of NavUnits
_BATHYMETRY = 3  # type of a channel
_GAPS = {"position": 10.0, "attitude": 1.0}  # [s], longest gaps that are interpolated
_GROWTH = 16  # bytes of memory per byte of the file, at most: a sounding has 4 bytes there


@dataclass(frozen=True, slots=True)
class Ranges:
    """Measurements of the echo sounder in one ping."""

    stamp: float  # [s, UTC]; 0 if the echo sounder has no clock
    model: str  # as in the packet
    sound_speed: float  # at the transducer [m/s]
    points: np.ndarray  # (n, 3) float64 [m] in the frame of the array: x forward, y port, z up
    flags: np.ndarray | None  # (n,) uint8, four flags each; None if the packet has none
    has_range: np.ndarray  # (n,) bool


def ranges_of(packet: bytes) -> Ranges:
    """The measurements in a packet BTH0."""
    sections = _sections(packet)
    if not {b"H0", b"R0"} <= sections.keys() or not sections.keys() & {b"A0", b"A2"}:
        raise InputError(f"has sections {b' '.join(sections).decode('ascii', 'replace')}; wanted H0, R0 and A0 or A2")
    header = np.frombuffer(_part(sections[b"H0"], 0, _H0.itemsize), _H0)[0]
    speed, count = float(header["sound_speed"]), int(header["count"])
    if not 1300 < speed < 1700:
        raise InputError(f"has a speed of sound of {speed:g} m/s; wanted 1300 to 1700 m/s")
    times = _integers(sections[b"R0"], _RANGES, count) * _float(sections[b"R0"], 0)  # two-way [s]
    ranges, angles = times * (speed / 2), _angles(sections, count)
    points = np.column_stack([np.zeros(count), -ranges * np.sin(angles), -ranges * np.cos(angles)])
    stamp, model = header["seconds"] + header["nanoseconds"] * 1e-9, header["model"].rstrip().decode("ascii", "replace")
    return Ranges(stamp, model, speed, points, _flags(sections.get(b"Q0"), count), ranges > 0)


def rejected(flags: np.ndarray, has_checks: bool) -> np.ndarray:
    """(n,) bool, which points the echo sounder rejects. `has_checks`: whether the recording uses the two flags for
    brightness and colinearity, which older versions never set."""
    undetected = (flags & _DETECTED) == 0
    return undetected | ((flags & _PASSED) != _PASSED) if has_checks else undetected


def _sections(packet: bytes) -> dict[bytes, bytes]:
    """The content of each section, without its name and size."""
    if len(packet) < _PACKET.size or packet[:4] != MAGIC:
        raise InputError("does not begin with BTH0")
    size, sections, start = min(_PACKET.unpack_from(packet)[1], len(packet)), dict[bytes, bytes](), _PACKET.size
    while start + _SECTION.size <= size:
        name, length = _SECTION.unpack_from(packet, start)
        if length < _SECTION.size or start + length > size:
            break
        sections.setdefault(name, packet[start + _SECTION.size : start + length])
        start += length
    return sections


def _angles(sections: dict[bytes, bytes], count: int) -> np.ndarray:
    """(n,) angles [rad] from the array's center line, positive to starboard, refused from a half turn on."""
    if b"A0" in sections:
        angles = np.linspace(_float(sections[b"A0"], 0), _float(sections[b"A0"], 4), count)
    else:
        steps = _integers(sections[b"A2"], _STEPS, count)
        angles = _float(sections[b"A2"], 0) + np.cumsum(steps) * _float(sections[b"A2"], 4)
    if not (np.abs(angles) < np.pi).all():
        raise InputError("has angles beyond a half turn")
    return angles


def _flags(section: bytes | None, count: int) -> np.ndarray | None:
    """(n,) uint8 flags of points, from four bits each, the first point in the higher ones."""
    if section is None or 2 * len(section) < count:
        return None
    packed = np.frombuffer(section, np.uint8, (count + 1) // 2)
    return np.column_stack([packed >> 4, packed & 15]).ravel()[:count]


def _integers(section: bytes, start: int, count: int) -> np.ndarray:
    """(n,) float64 from `count` unsigned 16-bit integers."""
    return np.frombuffer(_part(section, start, 2 * count), ">u2").astype(np.float64)


def _float(section: bytes, start: int) -> float:
    return struct.unpack(">f", _part(section, start, 4))[0]


def _part(section: bytes, start: int, size: int) -> bytes:
    """`size` bytes of a section from `start` on; refused if it has fewer."""
    if start + size > len(section):
        raise InputError(f"has a section of {len(section):,} bytes; wanted at least {start + size:,}")
    return section[start : start + size]


@dataclass(slots=True)
class _Packets:
    """Content of a file."""

    headers: list[bytes] = field(default_factory=list)  # of pings, 256 bytes each
    ranges: list[Ranges] = field(default_factory=list)
    attitudes: list[bytes] = field(default_factory=list)
    positions: list[bytes] = field(default_factory=list)
    kinds: Counter[int] = field(default_factory=Counter)
    skipped: int = 0  # bytes between packets, or of a truncated packet
    damaged: int = 0  # pings whose packet cannot be read
    first: str = ""  # the first damage, in words


def read_xtf(path: Path) -> RecordedLine:
    """The line of an XTF file."""
    # Only pyxtf's layouts are used. Its reader (xtf_read) unpickles a file NAME.pyxtf_idx beside the recording, which
    # could run any program; it also never ends at a damaged packet with a size of 0.
    import pyxtf

    content = read_content(path)
    require_memory("the file, unpacked,", _GROWTH * len(content), "split it")
    if len(content) < _FILE_HEADER:
        raise InputError(f"the file has {len(content):,} bytes, less than its header; write or copy it again")
    header = pyxtf.XTFFileHeader.from_buffer_copy(content[:_FILE_HEADER])
    packets = _packets(content, _FILE_HEADER * max(1, -(-min(header.channel_count(), 60) // _CHANNELS)))
    if not packets.ranges:
        raise InputError(_why_none(packets))
    if header.NavUnits != _DEGREES:
        raise InputError(f"its positions are not in degrees (NavUnits {header.NavUnits}, wanted 3); export it again")
    return _line(path.stem, header, packets, pyxtf)


def _packets(content: bytes, start: int) -> _Packets:
    """Read the packets that are used; after damage, continue at the next packet."""
    found = _Packets()
    for kind, first, last in _bounds(content, start, found):
        body = first + _PING_HEADER
        if kind in (_ATTITUDE, _NAVIGATION) and last - first >= _RAW_BYTES:
            packets = found.attitudes if kind == _ATTITUDE else found.positions
            packets.append(content[first : first + _RAW_BYTES])
        elif kind == _R2SONIC or (kind == _TRITON and content.startswith(MAGIC, body)):
            try:
                found.ranges.append(ranges_of(content[body:last]))
                found.headers.append(content[first:body])
            except InputError as error:
                found.damaged += 1
                found.first = found.first or f"the packet at byte {first:,} {error}"
        found.kinds[kind] += 1
    return found


def _bounds(content: bytes, start: int, found: _Packets) -> Iterator[tuple[int, int, int]]:
    """Type, first byte and end of each packet."""
    while start < len(content):
        end = start + int.from_bytes(content[start + 10 : start + _START], "little")
        if (
            content.startswith(_MAGIC, start)
            and _START <= end - start <= _LARGEST
            and (content.startswith(_MAGIC, end) or end == len(content))
        ):
            yield content[start + 2], start, end
        else:
            following = content.find(_MAGIC, start + 2)
            end = following if following >= 0 else len(content)
            found.skipped += end - start
            found.first = found.first or f"no packet at byte {start:,}"
        start = end


def _why_none(packets: _Packets) -> str:
    """Why the file has no ping, in words."""
    if packets.damaged:
        return f"none of its {packets.damaged:,} pings can be read: {packets.first}; copy it again"
    kinds = ", ".join(map(str, sorted(packets.kinds))) or "none"
    return f"it holds packets of type {kinds}; of XTF only R2Sonic's (BTH0) are read: export the line as GSF"


def _line(name: str, header, packets: _Packets, pyxtf) -> RecordedLine:
    heads = np.frombuffer(b"".join(packets.headers), _layout(pyxtf.XTFPingHeader))
    channel = next((each for each in header.ChanInfo if each.TypeOfChannel == _BATHYMETRY), header.ChanInfo[0])
    stamps = np.array([ranges.stamp or _epoch(head, head["HSeconds"] / 100) for ranges, head in
                       zip(packets.ranges, heads, strict=True)])  # fmt: skip
    attitudes, heave = _attitudes(stamps, heads, packets.attitudes, pyxtf)
    sensors = np.zeros((len(heads), 3))
    sensors[:, 2] = heave - heads["SensorDepth"]
    mounted = Rotation.from_euler("ZYX", [-channel.OffsetYaw, -channel.OffsetPitch, channel.OffsetRoll], degrees=True)
    turns = R_level_vehicle_of(np.nan_to_num(attitudes)).as_matrix() @ mounted.as_matrix()
    flags = [ranges.flags for ranges in packets.ranges if ranges.flags is not None]
    has_checks = any((each & _PASSED).any() for each in flags)
    points, flagged = list[np.ndarray](), list[np.ndarray]()
    for ranges, turn, sensor in zip(packets.ranges, turns, sensors, strict=True):
        measured = np.where(ranges.has_range[:, None], ranges.points, np.nan)
        points.append(measured @ turn.T + sensor)
        none = np.zeros(len(measured), bool)
        flagged.append(none if ranges.flags is None else rejected(ranges.flags, has_checks))
    return assembled(
        name,
        f"R2Sonic {packets.ranges[0].model}",
        stamps=stamps,
        fixes=np.column_stack([_places(stamps, heads, packets.positions, pyxtf), heads["OceanTide"]]),
        attitudes=attitudes,
        sensors=sensors,
        points=points,
        flagged=flagged,
        sound_speeds=[ranges.sound_speed for ranges in packets.ranges],
        below_water=bool(heads["SensorDepth"].any()),
        notes=_notes(header, channel) + damage(packets.skipped, packets.damaged, "ping", packets.first),
    )


def _places(stamps: np.ndarray, heads: np.ndarray, packed: list[bytes], pyxtf) -> np.ndarray:
    """(P, 2) latitudes and longitudes [deg] of the transducer, from the headers of pings; if these have none,
    interpolated from packets of raw positions, which are those of the transducer, too, within 1 cm in a real file."""
    places = np.column_stack([heads["SensorYcoordinate"], heads["SensorXcoordinate"]]).astype(np.float64)
    if places.any() or not packed:
        return places
    # "Microsecond" counts tenths of milliseconds
    times, raw = _series(packed, pyxtf.XTFPosRawNavigation, "Microsecond", 1e4, ("RawYcoordinate", "RawXcoordinate"))
    raw[:, 1] = np.unwrap(raw[:, 1], period=360)
    places, known = between(stamps, times, raw, _GAPS["position"], 0.1)
    places[~known] = np.nan
    return np.column_stack([places[:, 0], (places[:, 1] + 180) % 360 - 180])


def _attitudes(stamps: np.ndarray, heads: np.ndarray, packed: list[bytes], pyxtf) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) roll, pitch and heading [rad] and (P,) heave [m] at the times of the pings: interpolated between packets
    of the motion sensor, else the latest ones, in the headers of pings."""
    latest = np.column_stack([heads[key] for key in ("SensorRoll", "SensorPitch", "SensorHeading", "Heave")])
    latest = np.asarray(latest, np.float64)
    names = ("Roll", "Pitch", "Heading", "Heave")
    times, sensed = _series(packed, pyxtf.XTFAttitudeData, "Millisecond", 1e3, names)
    if not sensed[:, 2].any():  # a motion sensor without a compass
        sensed[:, 2] = np.interp(times, stamps, np.degrees(np.unwrap(np.radians(latest[:, 2]))))
    sensed[:, 2] = np.unwrap(sensed[:, 2], period=360)
    values, known = between(stamps, times, sensed, _GAPS["attitude"], 0.1)
    values[~known] = latest[~known]
    return np.radians(values[:, :3]), values[:, 3]


def _series(
    packed: list[bytes], structure, fraction: str, ticks: float, names: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """(n,) stamps [s, UTC] and (n, k) fields `names` of valid packets; the field `fraction` has `ticks` per second."""
    rows = np.frombuffer(b"".join(packed), _layout(structure))
    times = np.array([_epoch(row, row[fraction] / ticks) for row in rows])
    values = np.column_stack([rows[name] for name in names]).astype(np.float64)
    good = np.isfinite(times) & (np.abs(np.nan_to_num(values, nan=1e9)) <= 360).all(axis=1)
    return times[good], values[good]


def _layout(structure) -> np.dtype:
    """The dtype of a structure of pyxtf; NumPy's own conversion leaves out inherited fields."""
    fields = dict(pair for base in structure.__mro__ for pair in vars(base).get("_fields_", ()))
    offsets = [getattr(structure, name).offset for name in fields]
    formats = [np.dtype(kind) for kind in fields.values()]
    return np.dtype({"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": sizeof(structure)})


def _epoch(row: np.void, fraction: float) -> float:
    """The stamp of a packet [s, UTC]; NaN if it has no valid time."""
    try:
        parts = [int(row[key]) for key in ("Year", "Month", "Day", "Hour", "Minute", "Second")]
        return datetime(*parts, tzinfo=UTC).timestamp() + float(fraction)
    except ValueError:
        return float("nan")


def _notes(header, channel) -> list[str]:
    notes = list[str]()
    offsets = [channel.OffsetX, channel.OffsetY, channel.OffsetZ]
    if any(offsets):
        where = ", ".join(f"{offset:.2f}" for offset in offsets)
        notes.append(
            f"the transducer's offsets ({where} m to starboard, forward and down) are not added: positions and "
            "heave of pings are those of the transducer"
        )
    names = [f"{part}Offset{axis}" for part in ("Nav", "MRU") for axis in ("X", "Y", "Z", "Yaw", "Pitch", "Roll")]
    if any(getattr(header, name, 0) for name in names):
        notes.append("offsets of its navigation and motion sensors are not added: pings are corrected for them")
    return notes
