"""XTF, the eXtended Triton Format, with R2Sonic's packets as QINSy writes them (type 65): ranges and angles.

A ping is a header of 256 bytes (time, position and attitude of the sensor) and a packet BTH0. Its position and heave
are those of the transducer, as the format calls them (Sensor...): in a real harbor survey soundings agree to 1.8 cm so,
and to 3.6 cm when the offsets of the channel, (5.3, 1.2) m, are added. What of the offsets remains are the angles.
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
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.pings.assembly import RecordedPing, assembled, between, counted, matrices_of
from sonarmap.tools.files.readers.pings.r2sonic import Ranges, ranges_of, rejected, uses_checks
from sonarmap.tools.files.readers.pings.recorded import RecordedLine
from sonarmap.tools.files.user_file import read_content

_START = struct.Struct("<HBBHHHI")  # of every packet: magic number, type, channel, channels, -, -, bytes
_MAGIC = b"\xce\xfa"
_R2SONIC, _ATTITUDE = 65, 3
_FILE_HEADER, _PING_HEADER = 1024, 256
_CHANNELS = 6  # that the first file header describes; each further six take another
_LARGEST = 1 << 24  # bytes of a packet
_DEGREES = 3  # NavUnits
_BATHYMETRY = 3  # type of a channel
_GAP = 1.0  # seconds between attitudes that are interpolated
_GROWTH = 16  # bytes of memory that a byte of the file takes at most: a sounding has four there
# other packets with soundings, which this reader does not have
_OTHERS = {2: "raw bathymetry", 26: "Reson SeaBat snippets", 28: "bathymetry by x, y, z and angle", 30: "Reson 7k",
           56: "QINSy multibeam", 60: "Benthos C3D", 61: "Reson 7125", 62: "Reson 7125 snippets",
           68: "R2Sonic bathymetry of Triton", 73: "Kongsberg multibeam"}  # fmt: skip


@dataclass(slots=True)
class _Packets:
    """What of a file was understood."""

    headers: list[bytes] = field(default_factory=list)  # of pings, 256 bytes each
    ranges: list[Ranges] = field(default_factory=list)
    attitudes: list[bytes] = field(default_factory=list)
    kinds: Counter[int] = field(default_factory=Counter)
    skipped: int = 0  # bytes between packets, or of a packet that is cut
    damaged: int = 0  # pings whose packet cannot be read
    first: str = ""  # the first damage, in words


def read_xtf(path: Path) -> RecordedLine:
    """The line of an XTF file. Raises InputError: it has no pings of an R2Sonic, or no places on the Earth."""
    # Its layouts only. Its reader (xtf_read) unpickles a file that lies beside and is called NAME.pyxtf_idx, which
    # could run any program; it also never ends where a damaged packet says that it has no bytes.
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
        raise InputError(
            f"its positions are not in degrees (NavUnits {header.NavUnits}, wanted 3); export it with latitudes and "
            "longitudes"
        )
    return _line(path.stem, header, packets, pyxtf)


def _packets(content: bytes, start: int) -> _Packets:
    """Those that are wanted; after damage from the next packet on."""
    found = _Packets()
    for kind, first, last in _bounds(content, start, found):
        found.kinds[kind] += 1
        if kind == _ATTITUDE and last - first >= 64:
            found.attitudes.append(content[first : first + 64])
        elif kind == _R2SONIC:
            try:
                found.ranges.append(ranges_of(content[first + _PING_HEADER : last]))
                found.headers.append(content[first : first + _PING_HEADER])
            except InputError as error:
                found.damaged += 1
                found.first = found.first or f"the packet at byte {first:,} {error}"
    return found


def _bounds(content: bytes, start: int, found: _Packets) -> Iterator[tuple[int, int, int]]:
    """Type, first byte and end of each packet."""
    while start < len(content):
        kind = size = 0
        if content.startswith(_MAGIC, start) and start + _START.size <= len(content):
            kind, size = content[start + 2], int.from_bytes(content[start + 10 : start + 14], "little")
        end = start + size
        if _START.size <= size <= _LARGEST and (content.startswith(_MAGIC, end) or end == len(content)):
            yield kind, start, end
        else:
            following = content.find(_MAGIC, start + 2)
            end = following if following >= 0 else len(content)
            found.skipped += end - start
            found.first = found.first or f"no packet at byte {start:,}"
        start = end


def _why_none(packets: _Packets) -> str:
    """Why there is no ping, in words."""
    if packets.damaged:
        return f"none of its {packets.damaged:,} pings can be read: {packets.first}; copy it again"
    held = [name for kind, name in _OTHERS.items() if packets.kinds[kind]]
    if held:
        return (
            f"it holds {' and '.join(held)}; of XTF only R2Sonic's packets as QINSy writes them (type 65) are read: "
            "export it as GSF"
        )
    kinds = ", ".join(map(str, sorted(packets.kinds))) or "none"
    return f"it holds no soundings of a multibeam echo sounder (packets of type {kinds}); give a recorded line"


def _line(name: str, header, packets: _Packets, pyxtf) -> RecordedLine:
    heads = np.frombuffer(b"".join(packets.headers), _layout(pyxtf.XTFPingHeader))
    channel = next((each for each in header.ChanInfo if each.TypeOfChannel == _BATHYMETRY), header.ChanInfo[0])
    stamps = np.array([ranges.stamp or _epoch(head, head["HSeconds"] / 100) for ranges, head in
                       zip(packets.ranges, heads, strict=True)])  # fmt: skip
    attitudes, heave = _attitudes(stamps, heads, packets.attitudes, pyxtf)
    sensors = np.zeros((len(heads), 3))
    sensors[:, 2] = heave - heads["SensorDepth"]
    mounted = Rotation.from_euler("ZYX", [-channel.OffsetYaw, -channel.OffsetPitch, channel.OffsetRoll], degrees=True)
    turns = matrices_of(np.nan_to_num(attitudes)) @ mounted.as_matrix()
    flags = [ranges.flags for ranges in packets.ranges if ranges.flags is not None]
    has_checks = any(uses_checks(each) for each in flags)
    fixes = np.column_stack([heads["SensorYcoordinate"], heads["SensorXcoordinate"], heads["OceanTide"]])
    pings = []
    for k, ranges in enumerate(packets.ranges):
        kept = ranges.has_range if ranges.flags is None else ranges.has_range & ~rejected(ranges.flags, has_checks)
        points = ranges.points[kept] @ turns[k].T + sensors[k]
        pings.append(RecordedPing(stamps[k], tuple(fixes[k]), tuple(attitudes[k]), sensors[k], points, len(kept)))
    speeds = [ranges.sound_speed for ranges in packets.ranges]
    return assembled(name, pings, f"R2Sonic {packets.ranges[0].model}", speeds, _notes(header, channel, heads, packets))


def _attitudes(stamps: np.ndarray, heads: np.ndarray, packed: list[bytes], pyxtf) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) roll, pitch and heading [rad] and (P,) heave [m] at the times of the pings: between the packets of the
    motion sensor, as the headers of pings only have its latest; from those headers where there are none."""
    latest = np.column_stack([heads[key] for key in ("SensorRoll", "SensorPitch", "SensorHeading", "Heave")])
    latest = np.asarray(latest, np.float64)
    rows = np.frombuffer(b"".join(packed), _layout(pyxtf.XTFAttitudeData))
    times = np.array([_epoch(row, row["Millisecond"] / 1000) for row in rows])
    sensed = np.column_stack([rows[key] for key in ("Roll", "Pitch", "Heading", "Heave")]).astype(np.float64)
    good = np.isfinite(times) & (np.abs(np.nan_to_num(sensed, nan=1e9)) <= 360).all(axis=1)
    if not sensed[good, 2].any():  # a motion sensor without a compass
        sensed[good, 2] = np.interp(times[good], stamps, np.degrees(np.unwrap(np.radians(latest[:, 2]))))
    sensed = sensed[good]
    sensed[:, 2] = np.unwrap(sensed[:, 2], period=360)
    values, known = between(stamps, times[good], sensed, _GAP, 0.1)
    values[~known] = latest[~known]
    return np.radians(values[:, :3]), values[:, 3]


def _layout(structure) -> np.dtype:
    """The dtype of a packet of pyxtf; NumPy by itself forgets the fields that it inherits."""
    fields = dict(pair for base in structure.__mro__ for pair in vars(base).get("_fields_", ()))
    offsets = [getattr(structure, name).offset for name in fields]
    formats = [np.dtype(kind) for kind in fields.values()]
    return np.dtype({"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": sizeof(structure)})


def _epoch(row: np.void, fraction: float) -> float:
    """The stamp of a packet [s, UTC]; NaN where it has no time."""
    try:
        parts = [int(row[key]) for key in ("Year", "Month", "Day", "Hour", "Minute", "Second")]
        return datetime(*parts, tzinfo=UTC).timestamp() + float(fraction)
    except ValueError:
        return float("nan")


def _notes(header, channel, heads: np.ndarray, packets: _Packets) -> list[str]:
    notes = [] if heads["SensorDepth"].any() else ["depths count from the transducer, whose depth pings do not have"]
    offsets = [channel.OffsetX, channel.OffsetY, channel.OffsetZ]
    if any(offsets):
        where = ", ".join(f"{offset:.2f}" for offset in offsets)
        notes.append(
            f"the transducer's offsets ({where} m to starboard, forward and down) are not added, as the positions and "
            "heave of pings are its own"
        )
    names = [f"{part}Offset{axis}" for part in ("Nav", "MRU") for axis in ("X", "Y", "Z", "Yaw", "Pitch", "Roll")]
    if any(getattr(header, name, 0) for name in names):
        notes.append("offsets of its navigation and motion sensors are not added: pings are corrected for them")
    if packets.damaged or packets.skipped:
        notes.append(
            f"damaged or cut: {counted(packets.damaged, 'ping')} and {counted(packets.skipped, 'byte')} left out; "
            f"{packets.first}"
        )
    return notes
