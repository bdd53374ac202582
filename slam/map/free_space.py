"""Outliers of a map by free space: points that stand where the beams of other scans passed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kernels.points.visibility import octahedral_cells
from slam.map.beams import Beams, beams_of
from slam.map.fused_cells import pose_variance
from slam.map.point_map import PointMap
from slam.map.tiles import Tiles
from spectral.scan import Scan

_BEAMS_PER_CELL = 2.0  # along a side: a finer view has holes between the beams
_EDGES = (16, 256)  # of a view, coarsest and finest [cells]
_LEVELS = 3  # of each view, every next one half as fine, for points whose direction is less sure
_FILLED = 5  # of the nine cells about a point's direction, so many have to hold an echo
# A point contradicts a view if it lies nearer than everything about its direction by more than this: so many voxels,
# this share of the range, and so many standard deviations.
_REACH, _SLOPE, _SIGMAS = 1.0, 0.03, 2.0
_CROWD = 3  # of so many echoes in a cell the nearest is left out: it may be a wild one
_LEAST = 2  # scans that have to contradict a point


@dataclass(frozen=True, slots=True)
class Votes:
    """How many scans say what about each point of a map.

    Attributes:
        agree: (M,) int32, scans whose nearest surface in that direction is there.
        contradict: (M,) int32, scans whose beams passed there and met something farther off.
    """

    agree: np.ndarray
    contradict: np.ndarray


def clear(
    point_map: PointMap,
    scans: Sequence[Scan],
    T_world_sensor: RigidTransform,
    covariances: np.ndarray | None = None,
    beams: Sequence[Beams] | None = None,
) -> PointMap:
    """The map without the points that free space contradicts: see `votes` for the arguments.

    A point goes if at least two scans contradict it, more than agree with it, and more than have a point in its voxel.
    What no beam passed cannot be contradicted: echoes from behind a surface, as of multipath, stay.
    """
    vote = votes(point_map, scans, T_world_sensor, covariances, beams)
    support = np.maximum(vote.agree, point_map.seen)
    return point_map.keep((vote.contradict < _LEAST) | (vote.contradict <= support))


def votes(
    point_map: PointMap,
    scans: Sequence[Scan],
    T_world_sensor: RigidTransform,
    covariances: np.ndarray | None = None,
    beams: Sequence[Beams] | None = None,
) -> Votes:
    """Ask every scan that was seen from one viewpoint about every point of the map that its view takes in.

    Args:
        point_map: fused from the scans.
        scans: S of them.
        T_world_sensor: their S poses, in the map's frame.
        covariances: (S, 6, 6) of the poses, rotation first [rad, m], body tangent; certain without.
        beams: of the scans, where they are known already.
    """
    agree, contradict = np.zeros((2, len(point_map.points)), np.int32)
    tiles: Tiles | None = None
    for k, scan in enumerate(scans):
        scan_beams = beams_of(scan.points, point_map.voxel) if beams is None else beams[k]
        if not scan_beams.single:
            continue
        view = _view(scan, scan_beams)
        tiles = tiles or Tiles.of(point_map.points, view.reach)
        T = T_world_sensor[k]
        near = tiles.within(T.translation, view.reach)
        local = T.inv().apply(point_map.points[near])
        unsure = point_map.sigma[near].astype(np.float64) ** 2
        if covariances is not None:
            unsure += pose_variance(local, covariances[k])
        seen, passed = _ask(view, local, np.sqrt(unsure), point_map.voxel)
        agree[near] += seen
        contradict[near] += passed
    return Votes(agree, contradict)


@dataclass(frozen=True, slots=True)
class _View:
    """What one scan saw, over directions.

    Attributes:
        R_view_sensor: turns the middle of the beams to the octahedral map's, so that its seams lie behind.
        levels: of every fineness, (edge, edge) float64: the nearest range [m] of each cell and the eight around it;
            NaN where too few of these hold an echo to tell anything.
        reach: the farthest range [m].
    """

    R_view_sensor: Rotation
    levels: tuple[np.ndarray, ...]
    reach: float


def _view(scan: Scan, beams: Beams) -> _View:
    points = scan.points.astype(np.float64)
    ranges = np.sqrt(np.einsum("ij,ij->i", points, points))
    middle = (points / ranges[:, None]).mean(axis=0)
    all_around = np.linalg.norm(middle) < 1e-6
    R_view_sensor = Rotation.identity() if all_around else Rotation.align_vectors([[0.0, 0.0, 1.0]], [middle])[0]
    wanted = np.sqrt(4 * np.pi) / (_BEAMS_PER_CELL * max(beams.spacing, 1e-6))
    edge = int(2 ** np.clip(np.round(np.log2(wanted)), *np.log2(_EDGES)))
    cells = octahedral_cells(R_view_sensor.apply(points), edge)
    order = np.argsort(cells + ranges / (2 * ranges.max()))  # by cell, then by range
    filled, first, count = np.unique(cells[order], return_index=True, return_counts=True)
    near = np.full(edge * edge, np.inf)
    near[filled] = ranges[order[first + (count >= _CROWD)]]
    near = near.reshape(edge, edge)
    levels = []
    for _ in range(_LEVELS):
        levels.append(_spread(near))
        near = np.minimum(near[::2], near[1::2])  # several times faster than the minimum along two axes
        near = np.minimum(near[:, ::2], near[:, 1::2])
    return _View(R_view_sensor, tuple(levels), float(ranges.max()))


def _spread(near: np.ndarray) -> np.ndarray:
    """(edge, edge) the nearest of each cell's nine; nothing is known along the rim, where the map's seams are."""
    nearest = np.full(near.shape, np.nan)
    least, filled = near, np.isfinite(near).astype(np.int8)
    for _ in range(2):  # along one side, then along the other
        least = np.minimum(np.minimum(least[:-2], least[1:-1]), least[2:]).T
        filled = (filled[:-2] + filled[1:-1] + filled[2:]).T
    nearest[1:-1, 1:-1] = np.where(filled >= _FILLED, least, np.nan)
    return nearest


def _ask(view: _View, points: np.ndarray, sigma: np.ndarray, voxel: float) -> tuple[np.ndarray, np.ndarray]:
    """Which points (n, 3) [m, sensor frame], of standard deviations (n,) [m], a view agrees with, and contradicts."""
    ranges = np.sqrt(np.einsum("ij,ij->i", points, points))
    directions = view.R_view_sensor.apply(points)
    # the nine cells reach half again a cell's width to every side
    reach = 1.5 * np.sqrt(4 * np.pi) / len(view.levels[0]) * ranges
    doublings = np.ceil(np.log2(np.maximum(_SIGMAS * sigma, 1e-12) / np.maximum(reach, 1e-12)))
    nearest = np.full(len(points), np.nan)  # it stays so where the direction is not sure enough for any level
    for fineness, image in enumerate(view.levels):
        chosen = np.flatnonzero(np.maximum(doublings, 0) == fineness)
        nearest[chosen] = image.ravel()[octahedral_cells(directions[chosen], len(image))]
    tolerance = _REACH * voxel + _SLOPE * ranges + _SIGMAS * sigma
    return np.abs(ranges - nearest) <= tolerance, ranges + tolerance < nearest
