"""A line cut into scans, which are registered as any others; and the line where a map has its pieces."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import PingLine

# Of the swath's width: a piece is about half as long as it is wide, so that a neighboring line that shares a fifth
# with it sees a strip whose length is more than twice its width.
_LENGTH = 0.5
_FEWEST = 4  # pings of a piece
_GAP = 10.0  # usual steps from ping to ping; over a longer one no piece goes


@dataclass(frozen=True, slots=True)
class Piece:
    """The pings first to last - 1 of a line, as one scan.

    Attributes:
        middle: the ping in whose level frame, about the transducer, the piece is.
        points: (N, 3) float64 [m], soundings in this frame.
        viewpoints: (N, 3) float64 [m], where the transducer was for each.
        stamp: of the middle ping [s, UTC].
        T_world_piece: where the line's navigation has the frame.
    """

    first: int
    last: int
    middle: int
    points: np.ndarray
    viewpoints: np.ndarray
    stamp: float
    T_world_piece: RigidTransform


def swath_width(line: PingLine) -> float:
    """The median width of the swath [m], of a line with soundings."""
    starboard, port = (np.full(len(line.stamps), fill) for fill in (np.inf, -np.inf))
    np.minimum.at(starboard, line.pings, line.points[:, 1])
    np.maximum.at(port, line.pings, line.points[:, 1])
    return float(np.median((port - starboard)[np.isfinite(port)]))


def cut(line: PingLine, length: float | None = None) -> list[Piece]:
    """The line's pieces, two at least, without a gap and without a ping in two: pings that two pieces share would agree
    with themselves.

    Args:
        line: with soundings.
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
    pauses = np.flatnonzero(spans > _GAP * np.median(spans)) + 1 if len(spans) else []
    wanted = length or _LENGTH * swath_width(line)
    pieces: list[Piece] = []
    for stretch in np.split(np.arange(len(line.stamps)), pauses):
        way = np.concatenate([[0.0], np.cumsum(steps[stretch[:-1]])])
        count = max(1, min(max(2, round(way[-1] / max(wanted, 1e-9))), len(stretch) // _FEWEST))
        ends = np.searchsorted(way, way[-1] * np.arange(1, count) / count).tolist()
        bounds = [int(stretch[0]) + end for end in (0, *ends, len(stretch))]
        pieces += [piece for a, b in pairwise(bounds) if (piece := _piece(line, a, b)) is not None]
    return pieces


def _piece(line: PingLine, first: int, last: int) -> Piece | None:
    """None without soundings."""
    own = line.cut(first, last)
    if not len(own.pings):
        return None
    middle = int(np.searchsorted(own.stamps, (own.stamps[0] + own.stamps[-1]) / 2))
    sensors = own.world_sensors()
    T = RigidTransform.from_components(sensors[middle], own.T_world_level.rotation[middle])
    points, viewpoints = T.inv().apply(own.world_points()), T.inv().apply(sensors)[own.pings]
    return Piece(first, last, first + middle, points, viewpoints, float(own.stamps[middle]), T)


def moved(
    line: PingLine, middles: np.ndarray, T_world_patch: RigidTransform, covariances: np.ndarray
) -> tuple[PingLine, np.ndarray]:
    """The line with the navigation that a map gives it, and (P, 6) standard deviations of every ping's pose: rotation
    about the map's East, North, Up axes [rad], then along these [m].

    Each ping's frame about the transducer is turned and shifted, in its own axes, by what the patches before and behind
    it were, in proportion to time; before the first middle and after the last by that patch's.

    Args:
        middles: (n,) the ping in whose frame each patch is, ascending, n >= 1.
        T_world_patch: where the map has the patches.
        covariances: (n, 6, 6) of these, rotation first [rad, m], body tangent.
    """
    R_level, at = line.T_world_level.rotation, line.stamps[middles]
    T_sensor = RigidTransform.from_components(line.world_sensors(), R_level)
    xi = np.asarray((T_sensor[middles].inv() * T_world_patch).as_exp_coords())
    T_moved = T_sensor * RigidTransform.from_exp_coords(_at_pings(line, at, xi))
    T_world_old = T_moved * RigidTransform.from_translation(-line.sensors)  # the level frame as it was, moved along
    angles = (T_moved.rotation * line.R_level_vehicle).as_euler("ZYX")
    attitudes = np.column_stack([angles[:, 2], -angles[:, 1], (np.pi / 2 - angles[:, 0]) % (2 * np.pi)])
    new = replace(line, places=T_world_old.translation, attitudes=attitudes)
    T_new_old = new.T_world_level.inv() * T_world_old
    new = replace(new, points=T_new_old[line.pings].apply(line.points), sensors=T_new_old.apply(line.sensors))
    variances = _at_pings(line, at, np.diagonal(covariances, axis1=1, axis2=2))
    # along the world's axes, of those along the pings' own
    turned = np.einsum("pij,pkj->pki", R_level.as_matrix() ** 2, variances.reshape(-1, 2, 3))
    return new, np.sqrt(turned.reshape(-1, 6))


def _at_pings(line: PingLine, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(P, k) at the pings of what is (n, k) at times [s]."""
    return np.column_stack([np.interp(line.stamps, at, column) for column in values.T])
