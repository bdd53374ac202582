"""XTF, the eXtended Triton Format, with R2Sonic's packets, as QINSy writes them (type 65): ranges and angles.

A ping is a header of 256 bytes (time, position and attitude of the sensor) and a packet BTH0. Its position and heave
are those of the transducer, as the format calls them (Sensor...): in a real harbor survey soundings agree to 1.8 cm so,
and to 3.6 cm when the offsets of the channel, (5.3, 1.2) m, are added. What of the offsets remains are the angles.
"""

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
from sonarmap.tools.files.readers.pings.assembly import assembled, between, damage
from sonarmap.tools.files.readers.pings.r2sonic import MAGIC, Ranges, ranges_of, rejected, uses_checks
from sonarmap.tools.files.readers.pings.recorded import RecordedLine
from sonarmap.tools.files.user_file import read_content

_MAGIC, _START = b"\xce\xfa", 14  # of every packet: how it begins; bytes up to its size, which is their last four
_R2SONIC, _TRITON, _ATTITUDE = 65, 68, 3  # R2Sonic's as QINSy writes them; as Triton does, where they hold BTH0, too
_NAVIGATION, _PACKET = 107, 64  # raw positions; bytes of these and of attitudes
_FILE_HEADER, _PING_HEADER = 1024, 256
_CHANNELS = 6  # that the first file header describes; each further six take another
_LARGEST = 1 << 24  # bytes of a packet
_DEGREES = 3  # NavUnits
_BATHYMETRY = 3  # type of a channel
_GAPS = {"position": 10.0, "attitude": 1.0}  # seconds between two that are interpolated
_GROWTH = 16  # bytes of memory that a byte of the file takes at most: a sounding has four there
# other packets with soundings, which this reader does not have
_OTHERS = {2: "raw bathymetry", 5: "Elac ranges", 9: "SeaView bathymetry", 10: "SeaView depths", 16: "Elac XSE",
           17: "processed bathymetry (XYZA)", 19: "bathymetry of snippets", 22: "a single beam", 25: "multibeam",
           26: "QINSy single beam", 27: "QINSy multi-transducer", 28: "QINSy multibeam", 60: "Benthos C3D",
           61: "Reson 7125", 62: "Reson 7125 snippets", 68: "Triton's R2Sonic bathymetry", 70: "Coda Echoscope",
           73: "EdgeTech bathymetry", 74: "raw multibeam ranges", 78: "Reson water column",
           102: "processed bathymetry"}  # fmt: skip


@dataclass(slots=True)
class _Packets:
    """What of a file was understood."""

    headers: list[bytes] = field(default_factory=list)  # of pings, 256 bytes each
    ranges: list[Ranges] = field(default_factory=list)
    attitudes: list[bytes] = field(default_factory=list)
    positions: list[bytes] = field(default_factory=list)
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
        body = first + _PING_HEADER
        if kind in (_ATTITUDE, _NAVIGATION) and last - first >= _PACKET:
            packets = found.attitudes if kind == _ATTITUDE else found.positions
            packets.append(content[first : first + _PACKET])
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
    """Why there is no ping, in words."""
    if packets.damaged:
        return f"none of its {packets.damaged:,} pings can be read: {packets.first}; copy it again"
    held = [name for kind, name in _OTHERS.items() if packets.kinds[kind]]
    if held:
        return f"it holds {' and '.join(held)}; of XTF only R2Sonic's packets (BTH0) are read: export it as GSF"
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
    turns = R_level_vehicle_of(np.nan_to_num(attitudes)).as_matrix() @ mounted.as_matrix()
    flags = [ranges.flags for ranges in packets.ranges if ranges.flags is not None]
    has_checks = any(uses_checks(each) for each in flags)
    points = list[np.ndarray]()
    for ranges, turn, sensor in zip(packets.ranges, turns, sensors, strict=True):
        kept = ranges.has_range if ranges.flags is None else ranges.has_range & ~rejected(ranges.flags, has_checks)
        points.append(ranges.points[kept] @ turn.T + sensor)
    return assembled(
        name,
        f"R2Sonic {packets.ranges[0].model}",
        stamps=stamps,
        fixes=np.column_stack([_places(stamps, heads, packets.positions, pyxtf), heads["OceanTide"]]),
        attitudes=attitudes,
        sensors=sensors,
        points=points,
        beams=[len(ranges.has_range) for ranges in packets.ranges],
        sound_speeds=[ranges.sound_speed for ranges in packets.ranges],
        below_water=bool(heads["SensorDepth"].any()),
        notes=_notes(header, channel) + damage(packets.skipped, packets.damaged, "ping", packets.first),
    )


def _places(stamps: np.ndarray, heads: np.ndarray, packed: list[bytes], pyxtf) -> np.ndarray:
    """(P, 2) latitudes and longitudes [deg] from the headers of pings, which have the transducer's; where these have
    none, from packets of raw positions at these times: in a real file they are the transducer's, too, within 1 cm."""
    places = np.column_stack([heads["SensorYcoordinate"], heads["SensorXcoordinate"]]).astype(np.float64)
    if places.any() or not packed:
        return places
    # it counts tenths of milliseconds
    times, raw = _series(packed, pyxtf.XTFPosRawNavigation, "Microsecond", 1e4, ("RawYcoordinate", "RawXcoordinate"))
    raw[:, 1] = np.unwrap(raw[:, 1], period=360)
    places, known = between(stamps, times, raw, _GAPS["position"], 0.1)
    places[~known] = np.nan
    return np.column_stack([places[:, 0], (places[:, 1] + 180) % 360 - 180])


def _attitudes(stamps: np.ndarray, heads: np.ndarray, packed: list[bytes], pyxtf) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) roll, pitch and heading [rad] and (P,) heave [m] at the times of the pings: between the packets of the
    motion sensor, as the headers of pings only have its latest; from those headers where there are none."""
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
    """(n,) stamps [s, UTC] and (n, k) numbers of packets, those that can be; `fraction` counts so many in a second."""
    rows = np.frombuffer(b"".join(packed), _layout(structure))
    times = np.array([_epoch(row, row[fraction] / ticks) for row in rows])
    values = np.column_stack([rows[name] for name in names]).astype(np.float64)
    good = np.isfinite(times) & (np.abs(np.nan_to_num(values, nan=1e9)) <= 360).all(axis=1)
    return times[good], values[good]


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


def _notes(header, channel) -> list[str]:
    notes = list[str]()
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
    return notes
