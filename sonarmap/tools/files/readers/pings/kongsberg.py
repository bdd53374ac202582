"""Kongsberg's .all: soundings (XYZ 88), positions and attitudes, which are interpolated to the times of the pings.

Soundings are corrected for attitude, heave and refraction: they are in the level frame of the position's reference
point, down from the transmit transducer, whose depth below the water's level each ping has.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.pings.assembly import RecordedPing, assembled, between, counted, matrices_of
from sonarmap.tools.files.readers.pings.datagrams import (
    Datagram,
    Swath,
    datagrams_in,
    installation_of,
    motion_of,
    position_of,
    swath_of,
)
from sonarmap.tools.files.readers.pings.recorded import RecordedLine
from sonarmap.tools.files.user_file import read_content

_SWATH, _POSITION, _ATTITUDE, _INSTALLATION = "XPAI"
_OLDER = "D"  # depths of echo sounders before 2008
_GAPS = {"position": 10.0, "attitude": 1.0}  # seconds between two that are interpolated
_BEYOND = 2.0  # seconds before the first and after the last position: a file begins with any datagram
_GROWTH = 6  # bytes of memory that a byte of the file takes at most: a sounding has 20 there
_TWO_HEADS = "2"  # STC of a system of two heads, each with its own transducer


@dataclass(slots=True)
class _Content:
    """What of a file was understood."""

    swaths: list[tuple[Datagram, Swath]] = field(default_factory=list)
    positions: list[tuple[float, float, float]] = field(default_factory=list)  # stamp, latitude, longitude
    motions: list[np.ndarray] = field(default_factory=list)  # (n, 3) stamp, roll, pitch [deg]
    installation: dict[str, str] = field(default_factory=dict)
    system: int = 0  # of the positions
    older: int = 0  # soundings of a kind that is not read
    skipped: int = 0  # bytes
    damaged: int = 0  # datagrams
    first: str = ""  # the first damaged datagram, in words


def read_all(path: Path) -> RecordedLine:
    """The line of a .all file. Raises InputError: it has no soundings of the kind XYZ 88, or no positions."""
    content = read_content(path)
    require_memory("the file, unpacked,", _GROWTH * len(content), "split it")
    found = _content(content)
    if not found.swaths:
        what = "depth datagrams (D) of an older echo sounder" if found.older else "no soundings"
        raise InputError(f"it holds {what}; wanted XYZ 88 datagrams (X): give a recorded line, or export it as GSF")
    if len(found.positions) < 2:
        raise InputError("it holds less than two positions of the active system; record them, or export it as GSF")
    return _line(path.stem, found)


def _content(content: bytes) -> _Content:
    found = _Content()
    for datagram in datagrams_in(content, _SWATH + _POSITION + _ATTITUDE + _INSTALLATION + _OLDER):
        if isinstance(datagram, int):
            found.skipped += datagram
            continue
        try:
            _take(datagram, found)
        except InputError as error:
            found.damaged += 1
            found.first = found.first or f"a datagram {datagram.kind} {error}"
    return found


def _take(datagram: Datagram, found: _Content) -> None:
    if datagram.kind == _SWATH:
        found.swaths.append((datagram, swath_of(datagram.content)))
    elif datagram.kind == _POSITION:
        if (position := position_of(datagram.content)) is not None and np.isfinite(datagram.stamp):
            found.positions.append((datagram.stamp, *position[:2]))
            found.system = position[2]
    elif datagram.kind == _ATTITUDE:
        if (motion := motion_of(datagram.content)) is not None and np.isfinite(datagram.stamp):
            found.motions.append(motion + np.array([datagram.stamp, 0, 0]))
    elif datagram.kind == _INSTALLATION:
        found.installation = found.installation or installation_of(datagram.content)
    else:
        found.older += 1


def _line(name: str, found: _Content) -> RecordedLine:
    notes, stamps = list[str](), np.array([datagram.stamp for datagram, _ in found.swaths])
    positions = np.array(found.positions)
    positions[:, 2] = np.unwrap(positions[:, 2], period=360)  # across the date line
    places, placed = between(stamps, positions[:, 0], positions[:, 1:], _GAPS["position"], _BEYOND)
    places[:, 1] = (places[:, 1] + 180) % 360 - 180
    places[~placed] = np.nan
    motions = np.concatenate([*found.motions, np.empty((0, 3))])
    turned, known = between(stamps, motions[:, 0], motions[:, 1:], _GAPS["attitude"], _GAPS["attitude"])
    if not known.all():
        notes.append(f"{counted(int((~known).sum()), 'ping')} without roll and pitch, taken as level")
        turned[~known] = 0.0
    attitudes = np.column_stack([np.radians(turned), [swath.heading for _, swath in found.swaths]])
    sensors = _sensors(attitudes, found)
    pings = [
        RecordedPing(stamps[k], (*places[k], 0.0), tuple(attitudes[k]), sensors[k],
                     swath.points - [0, 0, swath.depth], swath.beams)
        for k, (_, swath) in enumerate(found.swaths)
    ]  # fmt: skip
    if found.skipped or found.damaged:
        words = f"; {found.first}" if found.first else ""
        notes.append(
            f"damaged or cut: {counted(found.skipped, 'byte')} and {counted(found.damaged, 'datagram')} left out{words}"
        )
    speeds = [swath.sound_speed for _, swath in found.swaths]
    return assembled(name, pings, f"Kongsberg EM{found.swaths[0][0].model}", speeds, notes)


def _sensors(attitudes: np.ndarray, found: _Content) -> np.ndarray:
    """(P, 3) the transmit transducers [m] in the level frames: their depths are in the pings, where they are beside
    the position's reference point follows from the installation."""
    values = found.installation
    serials = np.array([datagram.serial for datagram, _ in found.swaths])
    second = (serials == int(values.get("second", "0"))) & (values.get("STC") == _TWO_HEADS)
    reference = _place(values, f"P{found.system}")
    levers = np.where(second[:, None], _place(values, "S2") - reference, _place(values, "S1") - reference)
    sensors = np.einsum("pij,pj->pi", matrices_of(attitudes), levers)
    sensors[:, 2] = [-swath.depth for _, swath in found.swaths]
    return sensors


def _place(values: dict[str, str], what: str) -> np.ndarray:
    """(3,) [m] forward, to port and up of the vessel's reference point; 0 where the installation does not say."""
    try:
        x, y, z = (float(values.get(f"{what}{axis}", "0")) for axis in "XYZ")
    except ValueError:
        return np.zeros(3)
    return np.array([x, -y, -z]) if max(abs(x), abs(y), abs(z)) < 1000 else np.zeros(3)
