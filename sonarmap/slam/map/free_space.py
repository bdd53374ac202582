"""Visibility of a map's points: which scans agree with a point, and which contradict it, as their beams passed it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from sonarmap.kernels.points.visibility import octahedral_cells
from sonarmap.slam.map.placed import Beams, PlacedScans, pose_variance
from sonarmap.slam.map.point_map import PointMap
from sonarmap.spectral.scan import Scan

# A point contradicts a view if it lies nearer than everything about its direction by more than the sum of these.
_MARGIN_VOXELS = 1.0
_MARGIN_SHARE = 0.03  # of the range
_MARGIN_SIGMAS = 2.0
_BEAMS_PER_CELL = 2.0  # along a side: a finer view has holes between the beams
_EDGES = (16, 256)  # of a view, coarsest and finest [cells]
_LEVELS = 3  # of each view, every next one half as fine, for points whose direction is less certain
_FILLED = 5  # least number of the nine cells about a direction that hold an echo where a view is not empty
_ROUNDING = 1 + 1e-6  # factor by which the farthest point of a scan is within its reach
_CROWD = 3  # in a cell with at least this number of echoes, the nearest is ignored, as it may be false


@dataclass(frozen=True, slots=True)
class Votes:
    agree: np.ndarray  # (M,) int32, scans whose nearest surface in the point's direction is there
    contradict: np.ndarray  # (M,) int32, scans whose beams passed the point and hit something farther off
    looked: np.ndarray  # (M,) int32, scans with dense beams in the point's direction, whatever they hit
    behind: np.ndarray  # (M,) bool, whether the point's scan (`PointMap.scan`) saw something nearer all around it

    def take(self, chosen: np.ndarray) -> Votes:
        return Votes(self.agree[chosen], self.contradict[chosen], self.looked[chosen], self.behind[chosen])


def uncontradicted(point_map: PointMap, vote: Votes) -> np.ndarray:
    """(M,) bool: the points that free space does not contradict.

    More scans contradict a point that is not kept than agree with it, and more than have a point in its voxel. Echoes
    from behind a surface, such as multipath, are kept, as no beam passed them.
    """
    support = np.maximum(vote.agree, point_map.seen)
    return vote.contradict <= support


@threadpool_limits.wrap(limits=1, user_api="blas")  # its rounding depends on the number of threads
def votes(point_map: PointMap, placed: PlacedScans) -> Votes:
    """The votes of all scans with a single viewpoint on the points in their views."""
    agree, contradict, looked = np.zeros((3, len(point_map.points)), np.int32)
    behind, within = np.zeros(len(point_map.points), bool), ball_search(point_map.points)
    for k, (scan, beams) in enumerate(zip(placed.scans, placed.beams, strict=True)):
        if not beams.single:
            continue
        view, T = _view_of(scan, beams), placed.T_world_sensor[k]
        near = within(T.translation, view.reach)
        # as matrices, which is several times faster than `apply`
        local = (point_map.points[near] - T.translation) @ T.rotation.as_matrix()
        directions = local @ view.R_view_sensor.T
        variance = point_map.sigma[near].astype(np.float64) ** 2 + pose_variance(local, placed.covariances[k])
        agrees, contradicts, looks = _compare(view, local, directions, np.sqrt(variance), point_map.voxel)
        agree[near] += agrees
        contradict[near] += contradicts
        looked[near] += looks
        own = np.flatnonzero(point_map.scan[near] == placed.indices[k])
        ranges = np.linalg.norm(local[own], axis=1)  # in the point's own scan only its range errs
        ranges -= _tolerance(ranges, np.full(len(own), beams.sigma), point_map.voxel)
        behind[near[own]] = view.behind(directions[own], ranges)
    return Votes(agree, contradict, looked, behind)


def ball_search(points: np.ndarray) -> Callable[[np.ndarray, float], np.ndarray]:
    """A function that returns the ascending indices of the (M, 3) points [m] within a radius [m] of a center (3,).

    It searches a slab along x, which is thin if the points are ordered by x, as a map's are.
    """
    x = points[:, 0]
    most, least = np.maximum.accumulate(x), np.minimum.accumulate(x[::-1])[::-1]

    def within(center: np.ndarray, radius: float) -> np.ndarray:
        first = np.searchsorted(most, center[0] - radius)
        away = points[first : np.searchsorted(least, center[0] + radius, "right")] - center
        return first + np.flatnonzero(np.einsum("ij,ij->i", away, away) < radius**2)

    return within


def _compare(
    view: _View, points: np.ndarray, directions: np.ndarray, sigma: np.ndarray, voxel: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n,) bool each: the points (n, 3) [m, sensor frame] that a view agrees with, contradicts, and looked toward.

    `directions` (n, 3) are in the view's frame, and `sigma` (n,) are the points' standard deviations [m].
    """
    ranges = np.sqrt(np.einsum("ij,ij->i", points, points))
    # the nine cells reach 1.5 cells to every side
    reach = 1.5 * np.sqrt(4 * np.pi) / len(view.levels[0]) * ranges
    doublings = np.ceil(np.log2(np.maximum(_MARGIN_SIGMAS * sigma, 1e-12) / np.maximum(reach, 1e-12)))
    nearest = np.full(len(points), np.nan)  # stays NaN where the direction is too uncertain for every level
    for fineness, image in enumerate(view.levels):
        chosen = np.flatnonzero(np.maximum(doublings, 0) == fineness)
        nearest[chosen] = image.ravel()[octahedral_cells(directions[chosen], len(image))]
    tolerance = _tolerance(ranges, sigma, voxel)
    return np.abs(ranges - nearest) <= tolerance, ranges + tolerance < nearest, ~np.isnan(nearest)


def _tolerance(ranges: np.ndarray, sigma: np.ndarray, voxel: float) -> np.ndarray:
    """(n,) largest distance before or behind a surface at which a point counts as part of it [m]."""
    return _MARGIN_VOXELS * voxel + _MARGIN_SHARE * ranges + _MARGIN_SIGMAS * sigma


@dataclass(frozen=True, slots=True)
class _View:
    # (3, 3): turns the mean beam to the z axis, the center of the octahedral map, so that its seams lie behind
    R_view_sensor: np.ndarray
    # each (edge, edge) float64: the nearest range in each cell and the eight around it [m]; NaN where too few of these
    # hold an echo
    levels: tuple[np.ndarray, ...]
    # of the two finest levels, (edge, edge) float64: largest of the nine cells' nearest ranges [m]; NaN where a beam
    # may have passed between them
    closed: tuple[np.ndarray, ...]
    reach: float  # the farthest range [m]

    def behind(self, directions: np.ndarray, ranges: np.ndarray) -> np.ndarray:
        """(n,) bool: whether points lie farther than everything that was seen about their directions.

        The second image ignores clumps of false echoes, which neighboring beams share: it takes the nearest echo in
        each of its cells, four beams wide, and all nine cells have to hold one.

        Args:
            directions: (n, 3) in the view's frame, of any length.
            ranges: (n,) [m], minus their tolerances.
        """
        hidden = np.zeros(len(ranges), bool)
        for image in self.closed:
            hidden |= ranges > image.ravel()[octahedral_cells(directions, len(image))]
        return hidden


def _view_of(scan: Scan, beams: Beams) -> _View:
    """The view of a scan with a single viewpoint."""
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
    levels, closed = [], []
    for fineness in range(_LEVELS):
        levels.append(_nine(near, np.minimum, _FILLED))
        if fineness < 2:
            closed.append(_nine(near, np.maximum, 9 if fineness else _FILLED))
        near = np.minimum(near[::2], near[1::2])  # several times faster than the minimum along two axes
        near = np.minimum(near[:, ::2], near[:, 1::2])
    return _View(R_view_sensor.as_matrix(), tuple(levels), tuple(closed), _ROUNDING * float(ranges.max()))


def _nine(near: np.ndarray, pick: np.ufunc, least: int) -> np.ndarray:
    """(edge, edge) minimum or maximum (`pick`) over each cell and the eight around it.

    NaN where fewer than `least` of them hold an echo, and along the rim, where the map's seams are.
    """
    image = np.full(near.shape, np.nan)
    filled = np.isfinite(near)
    picked = near if pick is np.minimum else np.where(filled, near, -np.inf)
    filled = filled.astype(np.int8)
    for _ in range(2):  # along one side, then along the other
        picked = pick(pick(picked[:-2], picked[1:-1]), picked[2:]).T
        filled = (filled[:-2] + filled[1:-1] + filled[2:]).T
    image[1:-1, 1:-1] = np.where(filled >= least, picked, np.nan)
    return image
