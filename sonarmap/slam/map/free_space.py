"""What every scan saw over directions, what it thereby says of every point of a map, and which points go: beams passed
them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.points.visibility import octahedral_cells
from sonarmap.slam.execute.executor import Executor, this_process
from sonarmap.slam.map.placed import Beams, PlacedScans, pose_variance
from sonarmap.slam.map.point_map import PointMap
from sonarmap.slam.map.portions import in_portions
from sonarmap.spectral.scan import Scan

# A point contradicts a view if it lies nearer than everything about its direction by more than the sum of these.
_MARGIN_VOXELS = 1.0
_MARGIN_SHARE = 0.03  # of the range
_MARGIN_SIGMAS = 2.0
_MIN_CONTRADICTING = 2  # scans
_BEAMS_PER_CELL = 2.0  # along a side: a finer view has holes between the beams
_EDGES = (16, 256)  # of a view, coarsest and finest [cells]
_LEVELS = 3  # of each view, every next one half as fine, for points whose direction is less sure
# Of the nine cells about a direction, how many hold an echo where a view is not empty, and where it has no hole
_FILLED = 5
_CLOSED = 9
_ROUNDING = 1 + 1e-6  # the farthest point of a scan is within its own reach
# Where one of nine cells holds an echo, it is at most two cells away along either side of the map, which are 2 / edge
# wide there; a step on the octahedron is no longer than sqrt(6) of the larger of both, and seen from its middle sqrt(3)
# times that at most [rad * edge].
_ASIDE = 2 * 2 * np.sqrt(6) * np.sqrt(3)
_CROWD = 3  # echoes in a cell from which the nearest is left out, as it may be false


@dataclass(frozen=True, slots=True)
class Votes:
    agree: np.ndarray  # (M,) int32, scans whose nearest surface in that direction is there
    contradict: np.ndarray  # (M,) int32, scans whose beams passed there and met something farther off
    # (M,) int32, scans whose beams went that way, close together: they met the point, passed it, or met something
    # before it
    looked: np.ndarray
    # (M,) bool, whether the view of the scan that saw most of the point shows something nearer all about it
    behind: np.ndarray

    @classmethod
    def none(cls, count: int) -> Votes:
        """Of so many points, before any scan is asked."""
        agree, contradict, looked = np.zeros((3, count), np.int32)
        return cls(agree, contradict, looked, np.zeros(count, bool))

    def add(self, chosen: np.ndarray, more: Votes) -> None:
        """Add what other scans say about these points, (m,) int64, each once."""
        for field in fields(Votes):
            getattr(self, field.name)[chosen] += getattr(more, field.name)

    def take(self, chosen: np.ndarray) -> Votes:
        return Votes(self.agree[chosen], self.contradict[chosen], self.looked[chosen], self.behind[chosen])


def uncontradicted(point_map: PointMap, vote: Votes) -> np.ndarray:
    """The points that free space does not contradict, (M,) bool.

    A point goes if at least two scans contradict it, more than agree with it, and more than have a point in its voxel.
    What no beam passed cannot be contradicted: echoes from behind a surface, as of multipath, stay.
    """
    support = np.maximum(vote.agree, point_map.seen)
    return (vote.contradict < _MIN_CONTRADICTING) | (vote.contradict <= support)


def votes(point_map: PointMap, placed: PlacedScans, executor: Executor | None = None) -> Votes:
    """Ask every scan that was seen from one viewpoint about every point of the map that its view takes in; `executor`:
    who does it, by default this process."""
    total = Votes.none(len(point_map.points))
    within, near = ball_search(point_map.points), dict[range, np.ndarray]()

    def needs(places: range) -> tuple[PointMap, PlacedScans]:
        portion = placed.take(places)
        near[places] = within(*_ball_of(portion))
        return point_map.take(near[places]), portion

    for places, said in in_portions(executor or this_process(), placed.scans, _votes, needs):
        total.add(near.pop(places), said)
    return total


def _ball_of(placed: PlacedScans) -> tuple[np.ndarray, float]:
    """The center (3,) and the radius of a ball that holds all that scans see [m, world]."""
    places = placed.T_world_sensor.translation
    center = (places.min(axis=0) + places.max(axis=0)) / 2
    reaches = [float(np.linalg.norm(scan.points.astype(np.float64), axis=1).max()) for scan in placed.scans]
    return center, float((np.linalg.norm(places - center, axis=1) + reaches).max()) * _ROUNDING**2


def _votes(point_map: PointMap, placed: PlacedScans) -> Votes:
    said = Votes.none(len(point_map.points))
    within = ball_search(point_map.points)
    for k, (scan, beams) in enumerate(zip(placed.scans, placed.beams, strict=True)):
        if not beams.single:
            continue
        view, T = _view_of(scan, beams), placed.T_world_sensor[k]
        near = within(T.translation, view.reach)
        # as matrices, which is several times faster than `apply`
        local, R_view_sensor = (point_map.points[near] - T.translation) @ T.rotation.as_matrix(), view.R_view_sensor
        aside = local @ R_view_sensor[2] < view.widest * np.sqrt(np.einsum("ij,ij->i", local, local))
        near, local = near[~aside], local[~aside]
        directions = local @ R_view_sensor.T
        unsure = point_map.sigma[near].astype(np.float64) ** 2 + pose_variance(local, placed.covariances[k])
        seen, passed, asked = _ask(view, local, directions, np.sqrt(unsure), point_map.voxel)
        said.agree[near] += seen
        said.contradict[near] += passed
        said.looked[near] += asked
        own = np.flatnonzero(point_map.scan[near] == placed.indices[k])
        ranges = np.linalg.norm(local[own], axis=1)  # in its own view a point errs by its range alone
        ranges -= _tolerance(ranges, beams.sigma(ranges), point_map.voxel)
        said.behind[near[own]] = view.behind(directions[own], ranges)
    return said


def ball_search(points: np.ndarray) -> Callable[[np.ndarray, float], np.ndarray]:
    """A function that tells which of (M, 3) points [m] are nearer to a center (3,) than a radius [m], ascending.

    It measures those of a slab along x, which is thin where the points are ordered by x, as a map's are.
    """
    x = points[:, 0]
    most, least = np.maximum.accumulate(x), np.minimum.accumulate(x[::-1])[::-1]

    def within(center: np.ndarray, radius: float) -> np.ndarray:
        first = np.searchsorted(most, center[0] - radius)
        away = points[first : np.searchsorted(least, center[0] + radius, "right")] - center
        return first + np.flatnonzero(np.einsum("ij,ij->i", away, away) < radius**2)

    return within


def _ask(
    view: _View, points: np.ndarray, directions: np.ndarray, sigma: np.ndarray, voxel: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which points (n, 3) [m, sensor frame] a view agrees with, which it contradicts, and which it looked toward.

    Their directions (n, 3) are turned as the view's, and their standard deviations (n,) [m].
    """
    ranges = np.sqrt(np.einsum("ij,ij->i", points, points))
    # the nine cells reach half again a cell's width to every side
    reach = 1.5 * np.sqrt(4 * np.pi) / len(view.levels[0]) * ranges
    doublings = np.ceil(np.log2(np.maximum(_MARGIN_SIGMAS * sigma, 1e-12) / np.maximum(reach, 1e-12)))
    nearest = np.full(len(points), np.nan)  # it stays so where the direction is not sure enough for any level
    for fineness, image in enumerate(view.levels):
        chosen = np.flatnonzero(np.maximum(doublings, 0) == fineness)
        nearest[chosen] = image.ravel()[octahedral_cells(directions[chosen], len(image))]
    tolerance = _tolerance(ranges, sigma, voxel)
    return np.abs(ranges - nearest) <= tolerance, ranges + tolerance < nearest, ~np.isnan(nearest)


def _tolerance(ranges: np.ndarray, sigma: np.ndarray, voxel: float) -> np.ndarray:
    """How far a point may be before or behind a surface and still be taken for it (n,) [m]."""
    return _MARGIN_VOXELS * voxel + _MARGIN_SHARE * ranges + _MARGIN_SIGMAS * sigma


@dataclass(frozen=True, slots=True)
class _View:
    # (3, 3): turns the middle of the beams to the octahedral map's, the z axis, so that its seams lie behind
    R_view_sensor: np.ndarray
    widest: float  # cosine of an angle from the middle, beyond which no level tells anything
    # of every fineness, (edge, edge) float64: the nearest range [m] of each cell and the eight around it; NaN where too
    # few of these hold an echo to tell anything
    levels: tuple[np.ndarray, ...]
    # of the two finest, (edge, edge) float64: what the nine cells' nearest ranges do not exceed [m]; NaN where a beam
    # may have passed between them
    closed: tuple[np.ndarray, ...]
    reach: float  # the farthest range [m]

    def behind(self, directions: np.ndarray, ranges: np.ndarray) -> np.ndarray:
        """Whether places lie farther than all that was seen about their directions, (n,) bool.

        The second image sees past clumps of false echoes, which beams have in common with their neighbors: of each of
        its cells, four beams wide, the nearest counts, and every one has to hold an echo.

        Args:
            directions: (n, 3), of any length, as `R_view_sensor` turns them.
            ranges: (n,) [m], less what they may err.
        """
        hidden = np.zeros(len(ranges), bool)
        for image in self.closed:
            hidden |= ranges > image.ravel()[octahedral_cells(directions, len(image))]
        return hidden


def _view_of(scan: Scan, beams: Beams) -> _View:
    """The view of a scan that was seen from one viewpoint."""
    points = scan.points.astype(np.float64)
    ranges = np.sqrt(np.einsum("ij,ij->i", points, points))
    middle = (points / ranges[:, None]).mean(axis=0)
    all_around = np.linalg.norm(middle) < 1e-6
    R_view_sensor = Rotation.identity() if all_around else Rotation.align_vectors([[0.0, 0.0, 1.0]], [middle])[0]
    wanted = np.sqrt(4 * np.pi) / (_BEAMS_PER_CELL * max(beams.spacing, 1e-6))
    edge = int(2 ** np.clip(np.round(np.log2(wanted)), *np.log2(_EDGES)))
    turned = R_view_sensor.apply(points)
    cells = octahedral_cells(turned, edge)
    widest = np.arccos(np.clip((turned[:, 2] / ranges).min(), -1.0, 1.0)) + _ASIDE * 2 ** (_LEVELS - 1) / edge
    order = np.argsort(cells + ranges / (2 * ranges.max()))  # by cell, then by range
    filled, first, count = np.unique(cells[order], return_index=True, return_counts=True)
    near = np.full(edge * edge, np.inf)
    near[filled] = ranges[order[first + (count >= _CROWD)]]
    near = near.reshape(edge, edge)
    levels, closed = [], []
    for fineness in range(_LEVELS):
        levels.append(_nine(near, np.minimum, _FILLED))
        if fineness < 2:
            closed.append(_nine(near, np.maximum, _CLOSED if fineness else _FILLED))
        near = np.minimum(near[::2], near[1::2])  # several times faster than the minimum along two axes
        near = np.minimum(near[:, ::2], near[:, 1::2])
    least = float(np.cos(widest)) if widest < np.pi else -_ROUNDING
    return _View(R_view_sensor.as_matrix(), least, tuple(levels), tuple(closed), _ROUNDING * float(ranges.max()))


def _nine(near: np.ndarray, pick: np.ufunc, least: int) -> np.ndarray:
    """(edge, edge) np.minimum or np.maximum of each cell's nine, NaN where fewer than `least` hold an echo.

    Nothing is known along the rim, where the map's seams are.
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
