"""Reader of Kongsberg's .all: soundings, and positions and attitudes, which are interpolated to the pings' times.

Soundings are corrected for attitude, heave and refraction: they are in the level frame of the position's reference
point, with depths below the transmit transducer. Each ping has the transducer's depth below the water surface.
"""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import R_level_vehicle_of
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.pings.datagrams import (
    SWATHS,
    Datagram,
    Swath,
    datagrams_in,
    layout_of,
    swath_of,
    take_all,
)
from sonarmap.tools.files.readers.pings.recorded import RecordedLine, assembled, damage
from sonarmap.tools.files.readers.pings.sensors import UNUSED, USED, VELOCITIES, Sensors, lever_of
from sonarmap.tools.files.user_file import read_content

_POSITION, _MOTION, _NETWORK, _INSTALLATION = "PAnI"  # types; the third has attitudes by network
_OTHERS = {"raw ranges": "NfFe", "a water column": "k"}  # datagrams that are not read
_PLACE = layout_of("latitude:i4 longitude:i4 quality:u2 speed:u2 course:u2 heading:u2 system:u1 bytes:u1")
_SWING = layout_of("after:u2 status:u2 roll:i2 pitch:i2 heave:i2 heading:u2")
_NETWORK_HEAD = layout_of("count:u2 system:u1 spare:u1")
_NETWORK_SWING = layout_of("after:u2 roll:i2 pitch:i2 heave:i2 heading:u2 bytes:u1")
_COUNT, _BYTE = np.dtype("u2"), np.dtype("u1")
_ACTIVE = 0x80  # bit of a position's system
_ROLL_UNUSED = 0x02  # bit of an attitude's system
# Bits of a system by network. In real files a sensor whose velocities are used is also the one whose roll and pitch are
# used, from datagrams A, which come later.
_VELOCITIES_USED, _NOT_USED = 0x40, 0x80
_WRONG = (0x9A, 0xAF)  # first and last status, in either byte, of a motion sensor with invalid numbers
_UNKNOWN = 0xFFFF  # a speed or course
_GROWTH = 8  # bytes of memory per byte of the file, at most: a sounding has 16 or 20 there
_TWO_HEADS = "2"  # STC of a system of two heads, each with its own transducer
_NAMES = {2045: "2040C", 3020: "3002", **dict.fromkeys(range(3001, 3009), "3000D")}  # of models with another number
_NAMES |= {9901: "12S", 9902: "12D", 9903: "121", 9904: "100", 9905: "1000"}  # of MB-System's numbers


@dataclass(slots=True)
class _Content:
    """Content of a file."""

    swaths: list[tuple[Datagram, Swath]] = field(default_factory=list)
    sensors: Sensors = field(default_factory=Sensors)
    installation: dict[str, str] = field(default_factory=dict)


def read_all(path: Path) -> RecordedLine:
    """The line of a .all file."""
    content = read_content(path)
    require_memory("the file, unpacked,", _GROWTH * len(content), "split it")
    found = _Content()
    datagrams = datagrams_in(content, "".join([_POSITION, _MOTION, _NETWORK, _INSTALLATION, *SWATHS]))
    skipped, faults = take_all(datagrams, partial(_take, found=found))
    if not found.swaths:
        others = {name: any(isinstance(d, Datagram) for d in datagrams_in(content, k)) for name, k in _OTHERS.items()}
        held = " and ".join(name for name, is_there in others.items() if is_there)
        what = f"{held}, but no soundings" if held else "no soundings"
        raise InputError(f"it holds {what}; wanted datagrams X or D: give the line's .all, or export it as GSF")
    return _line(path.stem, found, damage(skipped, len(faults), "datagram", *faults[:1] or [""]))


def _take(datagram: Datagram, found: _Content) -> None:
    if datagram.kind in SWATHS:
        found.swaths.append((datagram, swath_of(datagram)))
    elif datagram.kind == _INSTALLATION:
        found.installation = found.installation or _installation(datagram)
    elif datagram.kind == _POSITION:
        _take_position(datagram, found.sensors)
    else:
        _take_motions(datagram, found.sensors)


def _take_position(datagram: Datagram, sensors: Sensors) -> None:
    row = datagram.rows(_PLACE)[0]
    speed, course = (np.nan if row[name] == _UNKNOWN else row[name] / 100 for name in ("speed", "course"))
    system = int(row["system"])
    fix = (row["latitude"] / 2e7, row["longitude"] / 1e7)
    sensors.add_position(
        USED if system & _ACTIVE else UNUSED, _POSITION, system & 3, datagram.stamp, fix, speed, course
    )


def _take_motions(datagram: Datagram, sensors: Sensors) -> None:
    if datagram.kind == _MOTION:
        count = int(datagram.rows(_COUNT)[0])
        rows = datagram.rows(_SWING, _COUNT.itemsize, count)
        system = int(datagram.rows(_BYTE, _COUNT.itemsize + rows.nbytes)[0])
        rank = UNUSED if system & _ROLL_UNUSED else USED
        status = np.stack([rows["status"] >> 8, rows["status"] & 0xFF])
        rows = rows[~((status >= _WRONG[0]) & (status <= _WRONG[1])).any(axis=0)]
    else:
        head, start, swings = datagram.rows(_NETWORK_HEAD)[0], _NETWORK_HEAD.itemsize, list[np.ndarray]()
        system = int(head["system"])
        rank = VELOCITIES if system & _VELOCITIES_USED else UNUSED
        rank = UNUSED if system & _NOT_USED else rank if system & _ROLL_UNUSED else USED
        for _ in range(int(head["count"])):
            swings.append(datagram.rows(_NETWORK_SWING, start))
            start += _NETWORK_SWING.itemsize + int(swings[-1]["bytes"][0])
        rows = np.concatenate(swings) if swings else np.empty(0, _NETWORK_SWING)
    values = np.column_stack([datagram.stamp + rows["after"] / 1000, rows["roll"] / 100, rows["pitch"] / 100])
    sensors.add_motions(rank, datagram.kind, system >> 4 & 3, values)


def _installation(datagram: Datagram) -> dict[str, str]:
    """{name: value} of the installation parameters, as S1X; the serial number of a second head is "second"."""
    second = datagram.rows(_COUNT)[0]
    text = datagram.content[_COUNT.itemsize :].decode("ascii", "replace")
    words = (word.partition("=") for word in text.strip("\0 \r\n").split(","))
    return {key.strip(): value.strip() for key, separator, value in words if separator} | {"second": str(second)}


def _line(name: str, found: _Content, damages: list[str]) -> RecordedLine:
    swaths = [swath for _, swath in found.swaths]
    stamps, model = np.array([datagram.stamp for datagram, _ in found.swaths]), found.swaths[0][0].model
    fixes = np.array([swath.fix for swath in swaths])
    has_fix = np.asarray((np.abs(fixes) <= [90, 180]).all(axis=1) & fixes.any(axis=1))
    places, system, notes = found.sensors.places(stamps)
    if np.isnan(places).all() and not has_fix.any():
        raise InputError("it holds no position near its pings; record positions, or export it as GSF")
    turned, of_motions = found.sensors.attitudes(stamps)
    attitudes = np.column_stack([np.radians(turned), [swath.heading for swath in swaths]])
    return assembled(
        name,
        f"Kongsberg EM{_NAMES.get(model, model)}",
        stamps=stamps,
        fixes=np.column_stack([np.where(has_fix[:, None], fixes, places), np.zeros(len(places))]),
        attitudes=attitudes,
        sensors=_sensors(attitudes, found, system),
        points=[swath.points - [0, 0, swath.depth] for swath in swaths],
        flagged=[swath.flagged for swath in swaths],
        sound_speeds=[swath.sound_speed for swath in swaths],
        notes=[*notes, *of_motions, *damages],
    )


def _sensors(attitudes: np.ndarray, found: _Content, system: int) -> np.ndarray:
    """(P, 3) positions of the transmit transducer [m] in the level frames: depths are from the pings, and
    horizontal offsets from the reference point of the position `system` from the installation parameters."""
    values = found.installation
    serials = np.array([datagram.serial for datagram, _ in found.swaths])
    second = (serials == int(values.get("second", "0"))) & (values.get("STC") == _TWO_HEADS)
    reference = lever_of(values, f"P{system}")
    levers = np.where(second[:, None], lever_of(values, "S2") - reference, lever_of(values, "S1") - reference)
    sensors = R_level_vehicle_of(attitudes).apply(levers)
    sensors[:, 2] = [-swath.depth for _, swath in found.swaths]
    return sensors
