"""Soundings of Kongsberg's datagrams: XYZ 88 (X), the older depths (D), and MB-System's own forms of both.

D counts in units that each ping has, and lists valid beams alone. MB-System's formats 57 and 59 add a place of the ping
and a flag of each beam.
"""

from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.pings.datagrams import Datagram, layout_of

_D_HEAD = " heading:u2 sound_speed:u2 depth:u2 most:u1 beams:u1 z_unit:u1 xy_unit:u1 rate:i2 "
_D = " z:i2 y:i2 x:i2 depression:i2 azimuth:u2 range:u2 quality:u1 window:u1 "
_X_HEAD = " sound_speed:u2 depth:f4 beams:u2 valid:u2 rate:f4 scanning:u1 spare:V3 "
_X = " z:f4 y:f4 x:f4 window:u2 quality:u1 adjustment:i1 detection:u1 cleaning:i1 strength:i2 "
_FIX, _RAY = " latitude:i4 longitude:i4 ", " depression:f4 azimuth:f4 range:f4 "
_MB_HEAD = _FIX + "heading:u2 heave:i2 roll:i2 pitch:i2 speed:u2" + _X_HEAD
# Of a datagram, and of each of its beams.
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
_IN_UNITS, _BY_MB_SYSTEM = "D\xe1", "\xe1\xe3\xe5"
_DEEP = {
    120,
    300,
    9901,
    9902,
    9903,
    9904,
    9905,
}  # their depths in D are unsigned; MB-System's for the EM12, 121, 100, 1000
# An EM3000D: its second head, with beams from 128 on, is deeper by what stands for the sampling rate [cm]. That of the
# model 3002 is no difference.
_TWO_HEADS, _SECOND = range(3003, 3009), 128
_MULTIPLIERS = range(-1, 18)  # of 655.36 m, which the transducer's depth in D lacks
_INVALID = 0x80  # of a sounding's detection
_NULL_OR_FLAGGED = 3  # of MB-System's flag


@dataclass(frozen=True, slots=True)
class Swath:
    """One ping.

    Attributes:
        heading: of the vessel [rad].
        sound_speed: at the transducer [m/s].
        depth: of the transmit transducer below the water's level [m].
        fix: latitude and longitude [deg] that MB-System has for it, or what it writes where it has none; NaN of others.
        points: (n, 3) float64 [m], not rejected: forward, to port and up from the position's reference point and that
            transducer's depth.
        beams: soundings in all.
    """

    heading: float
    sound_speed: float
    depth: float
    fix: tuple[float, float]
    points: np.ndarray
    beams: int


def swath_of(datagram: Datagram) -> Swath:
    """Of a datagram of a kind in SWATHS. Raises InputError: it is shorter than its count of beams claims, or its units
    are 0."""
    head_layout, layout = SWATHS[datagram.kind]
    head = datagram.rows(head_layout)[0]
    rows = datagram.rows(layout, head_layout.itemsize, int(head["beams"]))
    points, depth = np.column_stack([rows[axis].astype(np.float64) for axis in "xyz"]), float(head["depth"])
    kept = np.ones(len(rows), bool)
    if datagram.kind in _IN_UNITS:
        kept, depth = _in_meters(datagram, head, rows, points)
    if datagram.kind in _BY_MB_SYSTEM:
        kept &= rows["flag"] & _NULL_OR_FLAGGED == 0
    elif datagram.kind == "X":
        # realtime cleaning marks what it rejects with negative numbers
        kept &= (rows["detection"] & _INVALID == 0) & (rows["cleaning"] >= 0)
    fix = (head["latitude"] / 2e7, head["longitude"] / 1e7) if datagram.kind in _BY_MB_SYSTEM else (np.nan, np.nan)
    heading = np.radians(head["heading"] / 100) if head["heading"] <= 36000 else np.nan
    return Swath(heading, head["sound_speed"] / 10, depth, fix, points[kept] * [1, -1, -1], len(rows))


def _in_meters(datagram: Datagram, head: np.void, rows: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, float]:
    """Turn the points of a D datagram from its units to meters; which are soundings, and the transducer's depth [m]."""
    if not (head["z_unit"] and head["xy_unit"]):
        raise InputError("has units of 0 cm")
    deep = datagram.model in _DEEP
    if deep:
        points[:, 2] %= 1 << 16
    kept = (points[:, 2] != 0) & (points[:, 2] != (0xFFFF if deep else 0x7FFF)) & (points[:, :2] != 0x7FFF).all(axis=1)
    points *= np.array([head["xy_unit"], head["xy_unit"], head["z_unit"]]) / 100
    if datagram.model in _TWO_HEADS:
        points[rows["number"] >= _SECOND, 2] += head["rate"] / 100
    multiplier = int(datagram.rows(np.dtype("i1"), head.itemsize + rows.nbytes)[0])
    return kept, head["depth"] / 100 + 655.36 * multiplier * (multiplier in _MULTIPLIERS)
