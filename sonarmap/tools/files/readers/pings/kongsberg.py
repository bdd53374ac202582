"""Reader of Kongsberg's .all: soundings, and positions and attitudes, which are interpolated to the pings' times.

Soundings are corrected for attitude, heave and refraction: they are in the level frame of the position's reference
point, with depths below the transmit transducer. Each ping has the transducer's depth below the water surface.
"""

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import R_level_vehicle_of
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.pings.datagrams import SWATHS, Datagram, Swath, datagrams_in, layout_of, swath_of
from sonarmap.tools.files.readers.pings.recorded import RecordedLine, assembled, between, damage
from sonarmap.tools.files.user_file import read_content

_POSITION, _MOTION, _NETWORK, _INSTALLATION = "PAnI"  # types; the third has attitudes by network
_OTHERS = {"raw ranges": "NfFe", "a water column": "k"}  # datagrams that are not read
_PLACE = layout_of("latitude:i4 longitude:i4 quality:u2 speed:u2 course:u2 heading:u2 system:u1 bytes:u1")
_SWING = layout_of("after:u2 status:u2 roll:i2 pitch:i2 heave:i2 heading:u2")
_NETWORK_HEAD = layout_of("count:u2 system:u1 spare:u1")
_NETWORK_SWING = layout_of("after:u2 roll:i2 pitch:i2 heave:i2 heading:u2 bytes:u1")
_COUNT, _BYTE = np.dtype("u2"), np.dtype("u1")
_ACTIVE = 0x80  # bit of a position's system
_ROLL_UNUSED, _NOT_USED = 0x02, 0x80  # bits of an attitude's system, the second one only by network
_WRONG = (0x9A, 0xAF)  # first and last status, in either byte, of a motion sensor with invalid numbers
_GAPS = {"position": 10.0, "attitude": 1.0}  # [s], longest gaps that are interpolated
_BEYOND = 2.0  # [s], extrapolation of positions: a file may begin with any datagram
_LEAP, _FASTEST = 50.0, 40.0  # [m], [m/s] times the time between: a position farther from both neighbors is wrong
_DEGREE = 111_320.0  # meters of latitude
_GROWTH = 8  # bytes of memory per byte of the file, at most: a sounding has 16 or 20 there
_TWO_HEADS = "2"  # STC of a system of two heads, each with its own transducer
_NAMES = {3020: "3002", **dict.fromkeys(range(3001, 3009), "3000D")}  # of models with another number
_NAMES |= {9901: "12S", 9902: "12D", 9903: "121", 9904: "100", 9905: "1000"}  # of MB-System's numbers

# Key of a sensor: whether the echo sounder did not use it, its datagram type, and its number. Used sensors count as one
# with the number 0, as the echo sounder may have changed between them.
_Source = tuple[bool, str, int]


@dataclass(slots=True)
class _Content:
    """Content of a file. Sensors have (n, 4) rows: stamp, two angles [deg] and the number of the sensor."""

    swaths: list[tuple[Datagram, Swath]] = field(default_factory=list)
    positions: dict[_Source, list[np.ndarray]] = field(default_factory=lambda: defaultdict(list))
    motions: dict[_Source, list[np.ndarray]] = field(default_factory=lambda: defaultdict(list))
    installation: dict[str, str] = field(default_factory=dict)
    skipped: int = 0  # bytes that are no datagram
    faults: list[str] = field(default_factory=list)  # of damaged datagrams, in words


def read_all(path: Path) -> RecordedLine:
    """The line of a .all file."""
    content = read_content(path)
    require_memory("the file, unpacked,", _GROWTH * len(content), "split it")
    found = _content(content)
    if not found.swaths:
        others = {name: any(isinstance(d, Datagram) for d in datagrams_in(content, k)) for name, k in _OTHERS.items()}
        held = " and ".join(name for name, is_there in others.items() if is_there)
        what = f"{held}, but no soundings" if held else "no soundings"
        raise InputError(f"it holds {what}; wanted datagrams X or D: give the line's .all, or export it as GSF")
    return _line(path.stem, found)


def _content(content: bytes) -> _Content:
    found = _Content()
    for datagram in datagrams_in(content, "".join([_POSITION, _MOTION, _NETWORK, _INSTALLATION, *SWATHS])):
        if isinstance(datagram, int):
            found.skipped += datagram
            continue
        try:
            _take(datagram, found)
        except InputError as error:
            found.faults.append(f"a datagram {datagram.kind} {error}")
    return found


def _take(datagram: Datagram, found: _Content) -> None:
    if datagram.kind in SWATHS:
        found.swaths.append((datagram, swath_of(datagram)))
    elif datagram.kind == _INSTALLATION:
        found.installation = found.installation or _installation(datagram)
    elif np.isfinite(datagram.stamp):
        if datagram.kind == _POSITION:
            sensors, active, number, rows = found.positions, *_position(datagram)
        else:
            sensors, active, number, rows = found.motions, *_motion(datagram)
        source = (not active, datagram.kind, 0 if active else number)
        stamps, numbers = datagram.stamp + rows[:, 0], np.full(len(rows), number)
        sensors[source].append(np.column_stack([stamps, rows[:, 1:], numbers]))


def _position(datagram: Datagram) -> tuple[bool, int, np.ndarray]:
    """Whether the position system is active, its number, 1 to 3, and (1, 3) seconds after the stamp, latitude and
    longitude [deg]."""
    row = datagram.rows(_PLACE)[0]
    place = np.array([[0.0, row["latitude"] / 2e7, row["longitude"] / 1e7]])
    return bool(row["system"] & _ACTIVE), int(row["system"] & 3), place


def _motion(datagram: Datagram) -> tuple[bool, int, np.ndarray]:
    """Whether the sensor's roll was used, its number, and (n, 3) seconds after the stamp, roll and pitch [deg]."""
    if datagram.kind == _MOTION:
        count = int(datagram.rows(_COUNT)[0])
        rows = datagram.rows(_SWING, _COUNT.itemsize, count)
        system = int(datagram.rows(_BYTE, _COUNT.itemsize + rows.nbytes)[0])
        status = np.stack([rows["status"] >> 8, rows["status"] & 0xFF])
        rows = rows[~((status >= _WRONG[0]) & (status <= _WRONG[1])).any(axis=0)]
    else:
        head, start, swings = datagram.rows(_NETWORK_HEAD)[0], _NETWORK_HEAD.itemsize, list[np.ndarray]()
        system = int(head["system"])
        for _ in range(int(head["count"])):
            swings.append(datagram.rows(_NETWORK_SWING, start))
            start += _NETWORK_SWING.itemsize + int(swings[-1]["bytes"][0])
        rows = np.concatenate(swings) if swings else np.empty(0, _NETWORK_SWING)
    unused = _ROLL_UNUSED if datagram.kind == _MOTION else _ROLL_UNUSED | _NOT_USED
    values = np.column_stack([rows["after"] / 1000, rows["roll"] / 100, rows["pitch"] / 100])
    return not system & unused, system >> 4 & 3, values


def _installation(datagram: Datagram) -> dict[str, str]:
    """{name: value} of the installation parameters, as S1X; the serial number of a second head is "second"."""
    second = datagram.rows(_COUNT)[0]
    text = datagram.content[_COUNT.itemsize :].decode("ascii", "replace")
    words = (word.partition("=") for word in text.strip("\0 \r\n").split(","))
    return {key.strip(): value.strip() for key, separator, value in words if separator} | {"second": str(second)}


def _chosen(sensors: dict[_Source, list[np.ndarray]]) -> tuple[np.ndarray, bool]:
    """(n, 4) rows of the active sensors, else of the sensor with most rows; and whether they are active."""
    readings = {source: np.concatenate(rows) for source, rows in sensors.items() if any(len(each) for each in rows)}
    if not readings:
        return np.empty((0, 4)), True
    best = min(readings, key=lambda source: (*source[:2], -len(readings[source])))
    return readings[best], not best[0]


def _steady(positions: np.ndarray) -> np.ndarray:
    """(n, 4) positions ordered by time, with unwrapped longitudes; outliers far from both neighbors are left out."""
    on_earth = (np.abs(positions[:, 1]) <= 90) & (np.abs(positions[:, 2]) <= 180)
    positions = positions[on_earth]
    positions = positions[np.argsort(positions[:, 0], kind="stable")]
    positions[:, 2] = np.unwrap(positions[:, 2], period=360)
    if len(positions) < 3:
        return positions
    steps = np.diff(positions[:, :3], axis=0)
    steps[:, 2] *= np.cos(np.radians(positions[1:, 1]))
    far = _DEGREE * np.hypot(steps[:, 1], steps[:, 2]) > _LEAP + _FASTEST * steps[:, 0]
    return positions[~(np.concatenate([[True], far]) & np.concatenate([far, [True]]))]


def _line(name: str, found: _Content) -> RecordedLine:
    notes, swaths = list[str](), [swath for _, swath in found.swaths]
    stamps = np.array([datagram.stamp for datagram, _ in found.swaths])
    positions, active = _chosen(found.positions)
    positions = _steady(positions)
    fixes = np.array([swath.fix for swath in swaths])
    has_fix = np.asarray((np.abs(fixes) <= [90, 180]).all(axis=1) & fixes.any(axis=1))
    if len(positions) < 2 and not has_fix.any():
        raise InputError("it holds less than two positions; record them, or export it as GSF")
    if not active:
        notes.append("no position system is marked as active: that with most positions is taken")
    places, placed = between(stamps, positions[:, 0], positions[:, 1:3], _GAPS["position"], _BEYOND)
    places[:, 1] = (places[:, 1] + 180) % 360 - 180
    places[~placed] = np.nan
    places = np.where(has_fix[:, None], fixes, places)
    motions, active = _chosen(found.motions)
    if not active:
        notes.append("no motion sensor is marked as active: that with most attitudes is taken")
    turned, known = between(stamps, motions[:, 0], motions[:, 1:3], _GAPS["attitude"], _GAPS["attitude"])
    if not known.all():
        notes.append(f"{counted(int((~known).sum()), 'ping')} without roll and pitch, taken as level")
        turned[~known] = 0.0
    attitudes = np.column_stack([np.radians(turned), [swath.heading for swath in swaths]])
    model = found.swaths[0][0].model
    return assembled(
        name,
        f"Kongsberg EM{_NAMES.get(model, model)}",
        stamps=stamps,
        fixes=np.column_stack([places, np.zeros(len(places))]),
        attitudes=attitudes,
        sensors=_sensors(attitudes, found, int(positions[-1, 3]) if len(positions) else 0),
        points=[swath.points - [0, 0, swath.depth] for swath in swaths],
        flagged=[swath.flagged for swath in swaths],
        sound_speeds=[swath.sound_speed for swath in swaths],
        notes=notes + damage(found.skipped, len(found.faults), "datagram", *found.faults[:1] or [""]),
    )


def _sensors(attitudes: np.ndarray, found: _Content, system: int) -> np.ndarray:
    """(P, 3) positions of the transmit transducer [m] in the level frames: depths are from the pings, and
    horizontal offsets from the reference point of the position `system` from the installation parameters."""
    values = found.installation
    serials = np.array([datagram.serial for datagram, _ in found.swaths])
    second = (serials == int(values.get("second", "0"))) & (values.get("STC") == _TWO_HEADS)
    reference = _place(values, f"P{system}")
    levers = np.where(second[:, None], _place(values, "S2") - reference, _place(values, "S1") - reference)
    sensors = R_level_vehicle_of(attitudes).apply(levers)
    sensors[:, 2] = [-swath.depth for _, swath in found.swaths]
    return sensors


def _place(values: dict[str, str], what: str) -> np.ndarray:
    """(3,) position of `what` [m], forward, port and up of the vessel's reference point; 0 if unknown."""
    try:
        place = np.array([float(values.get(f"{what}{axis}", "0")) for axis in "XYZ"])
    except ValueError:
        return np.zeros(3)
    return place * [1, -1, -1] if (np.abs(place) < 1000).all() else np.zeros(3)
