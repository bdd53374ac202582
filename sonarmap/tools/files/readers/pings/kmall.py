"""Reader of Kongsberg's .kmall: soundings with their place and heading, attitudes, and positions for pings without.

Soundings (#MRZ) are corrected for attitude, heave and refraction: x forward, y starboard, z down from the vessel's
reference point, level. Each ping has the depths of its water line and transducer, so depths count from the water line.
"""

import re
from collections import defaultdict
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import R_level_vehicle_of
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.pings.datagrams import Datagram, layout_of, take_all
from sonarmap.tools.files.readers.pings.kmall_datagrams import Parts, datagrams_in, joined, strided
from sonarmap.tools.files.readers.pings.recorded import RecordedLine, assembled, damage
from sonarmap.tools.files.readers.pings.sensors import UNUSED, USED, Sensors, lever_of
from sonarmap.tools.files.user_file import read_content

_PINGS, _POSITION, _MOTION, _INSTALLATION = "#MRZ", "#SPO", "#SKM", "#IIP"
_COMMON = layout_of("bytes:u2 ping:u2 fans:u1 fan:u1 swaths:u1 swath:u1 transmitter:u1 receiver:u1")
_PING = layout_of(
    "bytes:u2 modes:V90 sectors:u2 sector_bytes:u2 heading:f4 sound_speed:f4 transducer:f4 water:f4 offsets:V8 "
    "status:V4 latitude:f8 longitude:f8 height:f4"
)
_RECEIVED = layout_of(
    "bytes:u2 main:u2 valid:u2 sounding_bytes:u2 rates:V16 alarm:u2 extra:u2 classes:u2 class_bytes:u2"
)
_SOUNDING = "index:u2 sector:u1 type:u1 method:u1 information:V3 class:u1 signal:V87 z:f4 y:f4 x:f4"
_SENSOR = layout_of("bytes:u2 system:u2 status:u2")
_FIX = layout_of("seconds:u4 nanoseconds:u4 quality:f4 latitude:f8 longitude:f8")
_SPEED = layout_of("speed:f4 course:f4")  # after the fix; an inactive or short datagram has none
_SAMPLES = layout_of("bytes:u2 system:u1 status:u1 format:u2 count:u2 sample_bytes:u2")
_SAMPLE = "name:V8 seconds:u4 nanoseconds:u4 status:u4 place:V20 roll:f4 pitch:f4"
_ACTIVE, _INVALID = 0x01, 0x10  # bits of a sensor's status
_WRONG_ATTITUDE = 0x02  # bit of a sample's status
_EXTRA, _REJECTED = 1, 2  # types of a detection; extra ones are others than the bottom's
_DISABLED = 100  # first class of extra detections that the operator disabled, or that are out of limits
_HIGHEST = 900.0  # [m]; the height above the ellipsoid is -999 or 0 where unknown
_FASTEST = 100.0  # [m/s]; unknown speeds are beyond it
_GROWTH = 8  # bytes of memory per byte of the file, at most: a sounding has 120 there
_ARRAY = re.compile(r"TRAI_TX(\d+):([^,]*)")
_AXIS = re.compile(r"(?:^|;)([XYZ])=(-?[\d.]+)")


@dataclass(frozen=True, slots=True)
class _Ping:
    """One fan of soundings."""

    stamp: float  # [s, UTC]
    model: int
    transmitter: int  # index of its array
    heading: float  # [rad]
    sound_speed: float  # [m/s]
    depth: float  # of the transmitter below the water line [m]
    water: float  # height of the water line above the ellipsoid [m], NaN if unknown
    points: np.ndarray  # (n, 3) float64 [m]: forward, port, up from the reference point at the water line
    flagged: np.ndarray  # (n,) bool, whether a sounding is rejected


@dataclass(slots=True)
class _Content:
    """Content of a file."""

    pings: list[_Ping] = field(default_factory=list)
    sensors: Sensors = field(default_factory=Sensors)
    levers: dict[int, np.ndarray] = field(default_factory=dict)  # {transmitter: (3,) forward, port, up [m]}
    parts: Parts = field(default_factory=lambda: defaultdict(list))
    seen: set[int] = field(default_factory=set)  # hashes of the pings' datagrams
    doubled: int = 0  # pings that the file has twice


def read_kmall(path: Path) -> RecordedLine:
    """The line of a .kmall file."""
    content = read_content(path)
    require_memory("the file, unpacked,", _GROWTH * len(content), "split it")
    found = _Content()
    skipped, faults = take_all(datagrams_in(content), partial(_take, found=found))
    faults += ["a ping lacks a part of its datagram" for waiting in found.parts.values() for _ in waiting]
    damages = damage(skipped, len(faults), "datagram", *faults[:1] or [""])
    if not found.pings:
        why = "".join(f" ({words})" for words in damages)
        raise InputError(f"it holds no soundings{why}; wanted datagrams #MRZ: give the line's .kmall, or copy it again")
    return _line(path.stem, found, damages)


def _take(datagram: Datagram, found: _Content) -> None:
    if datagram.kind == _PINGS:
        if (whole := joined(datagram, found.parts)) is not None:
            _take_ping(whole, found)
    elif datagram.kind == _POSITION:
        _take_position(datagram, found.sensors)
    elif datagram.kind == _MOTION:
        _take_motions(datagram, found.sensors)
    elif datagram.kind == _INSTALLATION:
        text = datagram.content.decode("ascii", "replace")
        found.levers |= {
            int(number) - 1: lever_of(dict(_AXIS.findall(values))) for number, values in _ARRAY.findall(text)
        }


def _take_ping(datagram: Datagram, found: _Content) -> None:
    common = datagram.rows(_COMMON)[0]
    start = int(common["bytes"])
    ping = datagram.rows(_PING, start)[0]
    start += int(ping["bytes"]) + int(ping["sectors"]) * int(ping["sector_bytes"])
    received = datagram.rows(_RECEIVED, start)[0]
    start += int(received["bytes"]) + int(received["classes"]) * int(received["class_bytes"])
    layout, count = strided(_SOUNDING, int(received["sounding_bytes"])), int(received["main"]) + int(received["extra"])
    rows = datagram.rows(layout, start, count)
    if (known := hash(datagram.content)) in found.seen:
        found.doubled += 1
        return
    found.seen.add(known)
    heading, height, water = float(ping["heading"]), float(ping["height"]), float(ping["water"])
    x, y, z = (rows[axis].astype(np.float64) for axis in "xyz")
    is_off = (rows["type"] == _EXTRA) & (rows["class"] >= _DISABLED)
    found.pings.append(
        _Ping(
            datagram.stamp,
            datagram.model,
            int(common["transmitter"]),
            np.radians(heading) if 0 <= heading <= 360 else np.nan,
            float(ping["sound_speed"]),
            float(ping["transducer"]),
            height - water if 0 < abs(height) < _HIGHEST else np.nan,
            np.column_stack([x, -y, water - z]),
            (rows["type"] >= _REJECTED) | (rows["method"] == 0) | is_off,
        )
    )
    fix = float(ping["latitude"]), float(ping["longitude"])
    found.sensors.add_position(USED, _PINGS, 0, datagram.stamp, fix, np.nan, np.nan)


def _take_position(datagram: Datagram, sensors: Sensors) -> None:
    sensor = datagram.rows(_SENSOR)[0]
    start, status = int(sensor["bytes"]), int(sensor["status"])
    place, speed, course = datagram.rows(_FIX, start)[0], np.nan, np.nan
    if len(datagram.content) >= start + _FIX.itemsize + _SPEED.itemsize:
        speed, course = (float(value) for value in datagram.rows(_SPEED, start + _FIX.itemsize)[0])
    if not (0 <= speed < _FASTEST and 0 <= course <= 360):
        speed = np.nan
    if not status & _INVALID:
        fix = float(place["latitude"]), float(place["longitude"])
        rank, number = USED if status & _ACTIVE else UNUSED, int(sensor["system"]) + 1
        sensors.add_position(rank, _POSITION, number, datagram.stamp, fix, speed, course)


def _take_motions(datagram: Datagram, sensors: Sensors) -> None:
    head = datagram.rows(_SAMPLES)[0]
    rows = datagram.rows(strided(_SAMPLE, int(head["sample_bytes"])), int(head["bytes"]), int(head["count"]))
    rows = rows[rows["status"] & _WRONG_ATTITUDE == 0]
    values = np.column_stack([rows["seconds"] + rows["nanoseconds"] * 1e-9, rows["roll"], rows["pitch"]])
    sensors.add_motions(USED if head["status"] & _ACTIVE else UNUSED, _MOTION, int(head["system"]) + 1, values)


def _line(name: str, found: _Content, damages: list[str]) -> RecordedLine:
    pings = found.pings
    stamps = np.array([ping.stamp for ping in pings])
    places, _, notes = found.sensors.places(stamps)
    if np.isnan(places).all():
        raise InputError("it holds no position near its pings; record positions, or export it as GSF")
    turned, of_motions = found.sensors.attitudes(stamps)
    attitudes = np.column_stack([np.radians(turned), [ping.heading for ping in pings]])
    sensors = R_level_vehicle_of(attitudes).apply([found.levers.get(ping.transmitter, np.zeros(3)) for ping in pings])
    sensors[:, 2] = [-ping.depth for ping in pings]
    water = np.array([ping.water for ping in pings])
    if np.isfinite(water).any():
        above = f"{np.nanmedian(water):.2f} m above the ellipsoid"
        notes.append(f"depths count from the water line, which was {above}: --heights ellipsoid removes tides")
    if found.doubled:
        notes.append(f"{counted(found.doubled, 'ping')} that the file has twice are read once")
    return assembled(
        name,
        f"Kongsberg EM{pings[0].model}",
        stamps=stamps,
        fixes=np.column_stack([places, np.zeros(len(places))]),
        attitudes=attitudes,
        sensors=sensors,
        points=[ping.points for ping in pings],
        flagged=[ping.flagged for ping in pings],
        sound_speeds=[ping.sound_speed for ping in pings],
        notes=[*notes, *of_motions, *damages],
        levels=water,
    )
