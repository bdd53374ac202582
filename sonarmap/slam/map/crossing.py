"""The distance between two passes over the same place: a measure of the map's error without ground truth."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.map.cell import cell_means, outline, overlapping
from sonarmap.slam.map.placed import PlacedScans

APART = 10  # smallest difference of the indices of two scans in different passes
PER_SCAN = 2  # largest number of crossings of a scan
SCANS = 1000  # largest number of scans among which crossings are sought; of more, an even selection
_CELL = 4.0  # edge of the cells in which overlap is counted [voxels]
_MIN_OVERLAP = 0.3  # share of cells in common
_SAMPLE = 1000  # points of a scan that are compared, about
_PLANE_POINTS = 8
_SHARED = 3.0  # both scans saw a point if its neighbor in the other scan is this near [voxels]
_MIN_SHARED = 50  # smallest number of points that both scans saw


@dataclass(frozen=True, slots=True)
class Spread:
    """Distances of the points of one pass from the surface of another: median and 90th percentile [m]."""

    median: float
    most: float


@dataclass(frozen=True, slots=True)
class Crossing:
    # i, j: the scans, i < j
    i: int
    j: int
    # before, after: distances where both scans saw the surface, at the poses before and after optimization
    before: Spread
    after: Spread


@dataclass(frozen=True, slots=True)
class CrossingError:
    """The crossings of a map, and their typical distances.

    Attributes:
        crossings: ordered by i, then j; none where no pass crosses another.
        before, after: the median over the crossings of their medians and 90th percentiles; None without any.
    """

    crossings: tuple[Crossing, ...]

    @classmethod
    def of(cls, errors: Iterable["CrossingError"]) -> "CrossingError":
        """The crossings of several components together."""
        return cls(tuple(crossing for error in errors for crossing in error.crossings))

    @property
    def before(self) -> Spread | None:
        return _typical([crossing.before for crossing in self.crossings])

    @property
    def after(self) -> Spread | None:
        return _typical([crossing.after for crossing in self.crossings])


def _typical(spreads: Sequence[Spread]) -> Spread | None:
    if not spreads:
        return None
    return Spread(
        float(np.median([spread.median for spread in spreads])), float(np.median([spread.most for spread in spreads]))
    )


def crossing_error(placed: PlacedScans, before: RigidTransform) -> CrossingError:
    """Distances between overlapping passes, under the poses before and after their optimization.

    Two scans cross if they overlap at the poses after and lie `APART` scans apart or in different surveys. A scan takes
    part in at most `PER_SCAN` crossings, those of largest overlap; of more than `SCANS` scans an even selection counts.
    Both scans are thinned to one mean per voxel, which averages some noise away. For each point that both saw at the
    poses after, the distance is that to the plane through the nearest points of the other scan, before and after. It
    contains the noise of the ranges and is not 0 at the true poses.

    Args:
        placed: S scans of one component at their optimized poses, their indices ascending as they were taken.
        before: their S chained poses.
    """
    if len(before) != len(placed.scans):
        raise InputError(f"{len(placed.scans)} scans and {len(before)} poses before: wanted one pose per scan")
    voxel, after, crossings = placed.voxel, placed.T_world_sensor, list[Crossing]()
    for a, b in _pairs(placed):
        target, source = (cell_means(placed.scans[k].points, voxel) for k in (a, b))
        tree = KDTree(target)
        T_before, T_after = (T[a].inv() * T[b] for T in (before, after))
        distance, _ = tree.query(T_after.apply(source), distance_upper_bound=_SHARED * voxel)
        shared = source[np.isfinite(distance)]
        shared = shared[:: max(1, len(shared) // _SAMPLE)]
        if len(shared) >= _MIN_SHARED and len(target) >= _PLANE_POINTS:
            spreads = [_spread(target, tree, T.apply(shared)) for T in (T_before, T_after)]
            crossings.append(Crossing(placed.indices[a], placed.indices[b], *spreads))
    return CrossingError(tuple(crossings))


def _pairs(placed: PlacedScans) -> list[tuple[int, int]]:
    """The pairs of scans that cross, as ascending positions in `placed`."""
    if len(placed.scans) < 2:
        return []
    chosen = np.arange(0, len(placed.scans), -(-len(placed.scans) // SCANS))
    outlines = [outline(placed.scans[k], _CELL * placed.voxel) for k in chosen.tolist()]
    pairs, overlap = overlapping(outlines, placed.T_world_sensor[chosen], _CELL * placed.voxel, _MIN_OVERLAP)
    pairs = chosen[pairs]
    index, survey = np.array(placed.indices)[pairs], np.array(placed.surveys)[pairs]
    apart = (np.abs(index[:, 0] - index[:, 1]) >= APART) | (survey[:, 0] != survey[:, 1])
    taken: Counter[int] = Counter()
    kept = []
    for k in np.lexsort((pairs[:, 1], pairs[:, 0], -overlap)):
        pair = int(pairs[k, 0]), int(pairs[k, 1])
        if apart[k] and max(taken[pair[0]], taken[pair[1]]) < PER_SCAN:
            taken.update(pair)
            kept.append(pair)
    return sorted(kept)


def _spread(surface: np.ndarray, tree: KDTree, points: np.ndarray) -> Spread:
    """Distances of points (n, 3) from the planes through the nearest points of a surface, in the same frame [m]."""
    near = surface[tree.query(points, _PLANE_POINTS)[1]]
    middle = near.mean(axis=1)
    away = near - middle[:, None]
    _, directions = np.linalg.eigh(np.einsum("nki,nkj->nij", away, away))
    distance = np.abs(np.einsum("ni,ni->n", points - middle, directions[:, :, 0]))
    return Spread(float(np.median(distance)), float(np.quantile(distance, 0.9)))
