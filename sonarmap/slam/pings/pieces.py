"""A line cut into scans for registration, and the line moved to where a map has these scans."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import PingLine

# Length of a piece [swath widths]: the strip that it shares with a neighboring line, a fifth of the width, is then more
# than twice as long as wide.
_LENGTH = 0.5
_MIN_PINGS = 4  # of a piece
_GAP = 10.0  # longest time between two pings of a piece [times the usual one between pings]
_USUAL = 90  # percentile of the times between pings: fans of one ping, up to eight, have the same time


@dataclass(frozen=True, slots=True)
class Piece:
    """The pings first to last - 1 of a line, as one scan.

    Attributes:
        middle: the ping that gives the piece its frame: level, with the transducer as origin.
        points: (N, 3) float64 [m], soundings in this frame.
        viewpoints: (N, 3) float64 [m], position of the transducer for each sounding.
        stamp: of the middle ping [s, UTC].
        T_world_piece: pose of the frame by the line's navigation.
    """

    first: int
    last: int
    middle: int
    points: np.ndarray
    viewpoints: np.ndarray
    stamp: float
    T_world_piece: RigidTransform


def swath_width(line: PingLine) -> float:
    """Median width of the swath of a line with soundings [m]."""
    starboard, port = (np.full(len(line.stamps), fill) for fill in (np.inf, -np.inf))
    np.minimum.at(starboard, line.pings, line.points[:, 1])
    np.maximum.at(port, line.pings, line.points[:, 1])
    return float(np.median((port - starboard)[np.isfinite(port)]))


def cut(line: PingLine, length: float | None = None) -> list[Piece]:
    """Cut a line into pieces, two or more if it has enough pings; no piece spans a pause, no ping is in two pieces.

    Args:
        length: of a piece along the track [m]; None for half the swath's width.

    Raises:
        InputError: a length that is not above 0, or no soundings.
    """
    if length is not None and not length > 0:
        raise InputError(f"pieces of {length:g} m: wanted a length above 0")
    if not len(line.pings):
        raise InputError(f"{line.name} has no soundings that are not rejected")
    steps = np.linalg.norm(np.diff(line.places[:, :2], axis=0), axis=1)
    spans = np.diff(line.stamps)
    pauses = np.flatnonzero(spans > _GAP * np.percentile(spans, _USUAL)) + 1 if len(spans) else []
    wanted = length or _LENGTH * swath_width(line)
    pieces: list[Piece] = []
    for stretch in np.split(np.arange(len(line.stamps)), pauses):
        track = np.concatenate([[0.0], np.cumsum(steps[stretch[:-1]])])
        count = max(1, min(max(2, round(track[-1] / max(wanted, 1e-9))), len(stretch) // _MIN_PINGS))
        ends = np.searchsorted(track, track[-1] * np.arange(1, count) / count).tolist()
        bounds = [int(stretch[0]) + end for end in (0, *ends, len(stretch))]
        pieces += [piece for a, b in pairwise(bounds) if (piece := _piece(line, a, b)) is not None]
    return pieces


def _piece(line: PingLine, first: int, last: int) -> Piece | None:
    """The piece of the pings first to last - 1; None without soundings."""
    part = line.cut(first, last)
    if not len(part.pings):
        return None
    middle = int(np.searchsorted(part.stamps, (part.stamps[0] + part.stamps[-1]) / 2))
    sensors = part.world_sensors()
    T = RigidTransform.from_components(sensors[middle], part.T_world_level.rotation[middle])
    points, viewpoints = T.inv().apply(part.world_points()), T.inv().apply(sensors)[part.pings]
    return Piece(first, last, first + middle, points, viewpoints, float(part.stamps[middle]), T)


def moved(
    line: PingLine, middles: np.ndarray, T_world_patch: RigidTransform, covariances: np.ndarray
) -> tuple[PingLine, np.ndarray]:
    """The line with its navigation corrected by a map, and (P, 6) standard deviations of every ping's pose: rotation
    about the map's East, North, Up axes [rad], then translation along these [m].

    The correction of a ping's frame at the transducer, in its own axes, is interpolated over time between those of the
    pieces before and after it; it is constant before the first middle and after the last.

    Args:
        middles: (n,) the middle ping of each piece, ascending, n >= 1.
        T_world_patch: poses of the pieces in the map.
        covariances: (n, 6, 6) of these, rotation first [rad, m], body tangent.
    """
    R_level, at = line.T_world_level.rotation, line.stamps[middles]
    T_sensor = RigidTransform.from_components(line.world_sensors(), R_level)
    xi = np.asarray((T_sensor[middles].inv() * T_world_patch).as_exp_coords())
    T_moved = T_sensor * RigidTransform.from_exp_coords(_at_pings(line, at, xi))
    T_world_old = T_moved * RigidTransform.from_translation(-line.sensors)  # the old level frame, moved along
    angles = (T_moved.rotation * line.R_level_vehicle).as_euler("ZYX")
    attitudes = np.column_stack([angles[:, 2], -angles[:, 1], (np.pi / 2 - angles[:, 0]) % (2 * np.pi)])
    new = replace(line, places=T_world_old.translation, attitudes=attitudes)
    T_new_old = new.T_world_level.inv() * T_world_old
    new = replace(new, points=T_new_old[line.pings].apply(line.points), sensors=T_new_old.apply(line.sensors))
    variances = _at_pings(line, at, np.diagonal(covariances, axis1=1, axis2=2))
    # from the pings' axes to the world's
    turned = np.einsum("pij,pkj->pki", R_level.as_matrix() ** 2, variances.reshape(-1, 2, 3))
    return new, np.sqrt(turned.reshape(-1, 6))


def _at_pings(line: PingLine, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(P, k) at the pings, interpolated from (n, k) values at times `at` [s]."""
    return np.column_stack([np.interp(line.stamps, at, column) for column in values.T])
