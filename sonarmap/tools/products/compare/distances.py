"""Distances between two surveys, each with its level of detection, and what can be said of each core point.

The errors of all poses and of the alignment move whole stretches of a surface. Most of a place does not change between
two surveys, so that its surface says how large these errors are: they are estimated from all distances together, held
by their covariances, distances beyond their scatter being left out (Tukey's biweight). What is left of their
covariance, noise and roughness make the level of detection.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
from scipy import sparse
from scipy.linalg import block_diag
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from sonarmap.tools.products.compare.surface import RADIUS, Cores, Epoch, cores_of, faced, layer_of, levers, planes_at

_LEVEL = 1.96  # sigmas, of 95 %
# Found on simulated pairs of surveys, see docs/measured. _NOISE: the variance of a mean over what the scatter of its
# points says, as a map's points lie in voxels. Then by what two surveys see edges and corners differently [voxels]: how
# far points are from their plane beyond _PLANE, and the squared tangent of the angle between both planes times _TILTED
# and, where neither survey has a plane, more. _ERRING: squared tangent by which a normal errs at most, by noise.
_NOISE, _PLANE, _TILTED, _TILTED_ROUGH = 0.5, 0.3, 0.7, 6.0
_ERRING, _LEAST_COSINE = 0.05, 0.1
_SHARED = 4.0  # by which noise is larger in the estimate of the poses: what surfaces seen from two places differ by
OVERLAP = np.pi * RADIUS**2  # core points whose cylinders share their points
_BIWEIGHT, _ROUNDS = 4.0, 8  # [sigmas] beyond which a distance does not count; rounds of weights
_USUAL = 0.6745  # quantile of |x| / sigma that half of all are below
# Patches of so many voxels tell by how much sums err more than all that is known; a third of them may have changed.
_PATCH, _FEWEST_IN_PATCH, _MOST_PATCHES = 6.0, 12, 500
_UNCHANGED, _UNCHANGED_SIGMAS = 2 / 3, 0.9674  # share of the patches that tells, and below what a normal error's are
_FAR = 1.75  # [voxels], from which distance on both surfaces cannot be mixed up
_STEEP = 0.5  # largest upward part of the normal of a wall, of which a cloud may show the other side
_CHUNK = 20_000


class Verdict(IntEnum):
    """What can be said of a core point."""

    UNCHANGED = 0  # the distance is below its level of detection, and that is small
    GAINED = 1  # the surface is now nearer to where it was seen from, by more than the level
    LOST = 2  # farther away
    UNSURE = 3  # the level is above its bound, and the distance below the level
    OLD_ONLY = 4  # the new survey has no surface there: not seen, hidden, too few points, or farther than the reach
    NEW_ONLY = 5  # the old survey has none


@dataclass(frozen=True, slots=True)
class Distances:
    """Of K core points, those of NEW_ONLY last."""

    cores: Cores  # frame of the old map
    distance: np.ndarray  # (K,) float64 along the normal [m], positive where the surface was gained; NaN where unknown
    level: np.ndarray  # (K,) float64 level of detection at 95 % [m]; NaN where unknown
    verdict: np.ndarray  # (K,) int64, of Verdict
    # of the m core points that both have, the first m where `compared`
    compared: np.ndarray  # (m,) int64, which these are
    noise: np.ndarray  # (m,) variance that neighbors do not share beyond their cylinders [m^2]
    shape: np.ndarray  # (m,) standard deviation that neighbors may share, where surfaces are no planes [m]
    shared: Any  # sparse (m, s) by what the s common errors move each distance
    covariance: np.ndarray  # (s, s) of these
    widened: float  # factor on all sigmas, by the scatter of the distances
    voxel: float  # [m]
    # factor on the sigmas of sums beside that, where neighbors err together, as in scans that are bent
    together: float = 1.0

    @property
    def sigma(self) -> np.ndarray:
        """(K,) standard deviation of the distance [m]."""
        return self.level / _LEVEL

    def sigma_of_sum(self, chosen: np.ndarray) -> float:
        """Standard deviation of the volume of some of the m core points, an index: the sum of area times distance
        [m^3]. Common errors count together; noise does as far as cylinders share points."""
        area = self.cores.area[self.compared[chosen]]
        J = self.shared[chosen].T @ area
        overlap = np.minimum(np.pi * (RADIUS * self.voxel) ** 2 / area, len(area))
        own = (area**2 * self.noise[chosen] * overlap).sum() + (area @ self.shape[chosen]) ** 2
        return self.together * self.widened * float(np.sqrt(J @ self.covariance @ J + own))


def distances_between(
    old: Epoch, new: Epoch, alignment: np.ndarray | None, voxel: float, reach: float, bound: float
) -> Distances:
    """From the old survey's surface to the new one's, sought up to `reach` [m] along the normal, both in the old one's
    frame. The alignment is the (6, 6) covariance of the new frame in the old one [rad, m], left tangent; None for two
    surveys of one map. The voxel decides about radii [m]; up to the level of detection `bound` [m] a place may be
    unchanged."""
    cores = cores_of(old, voxel)
    before, after = layer_of(old, cores, voxel, 0.0), layer_of(new, cores, voxel, reach)
    both = np.flatnonzero(np.isfinite(before.height + after.height))
    scans, prior = _shared(old, new, (before.shares[both], after.shares[both]), alignment)
    points, normals = cores.points[both], cores.normals[both]
    shared = _lifted(scans, levers(points, normals))
    noise = _NOISE * (before.variance[both] + after.variance[both])
    measured = after.height[both] - before.height[both]
    shape, tilt = _shape(old, new, cores.take(both), measured, voxel)
    errors, covariance = _common_errors(measured, noise + shape**2, shared, prior)
    moved = measured + shared @ errors
    # a shift along the surface shows as a distance where a normal errs
    shift = [_lifted(scans, levers(points, np.tile(axis, (len(both), 1)))) @ errors for axis in np.eye(3)]
    aside = np.square(shift).sum(axis=0) - (shared @ errors) ** 2
    shape = np.sqrt(shape**2 + np.maximum(aside, 0.0) * np.minimum(tilt, _ERRING))
    sigma = np.sqrt(noise + shape**2 + _spread(shared, covariance))
    widened = max(1.0, float(np.median(np.abs(moved) / sigma)) / _USUAL) if len(both) else 1.0
    fresh = cores_of(new, voxel)
    fresh = fresh.take(~faced(fresh, cores, voxel, reach))
    count = len(cores.points)
    every_core = Cores(*(np.concatenate(pair) for pair in zip(_columns(cores), _columns(fresh), strict=True)))
    distance, level = np.full((2, len(every_core.points)), np.nan)
    distance[both], level[both] = moved, _LEVEL * widened * sigma
    verdict = np.full(len(distance), Verdict.OLD_ONLY, np.int64)
    verdict[count:] = Verdict.NEW_ONLY
    verdict[both] = np.where(level[both] <= bound, Verdict.UNCHANGED, Verdict.UNSURE)
    beyond = np.abs(distance) > level  # NaN is not
    doubtful = both[beyond[both] & _doubtful(old, new, cores.take(both), moved, voxel)]
    beyond[doubtful] = False
    verdict[doubtful] = Verdict.UNSURE
    verdict[beyond] = np.where(distance[beyond] > 0, Verdict.GAINED, Verdict.LOST)
    found = Distances(every_core, distance, level, verdict, both, noise, shape, shared, covariance, widened, voxel)
    return replace(found, together=_together(found))


def _together(distances: Distances) -> float:
    """By how much sums over patches are larger than they would be if neighbors erred each by itself; 1 if not."""
    voxel, known = distances.voxel, distances.verdict[distances.compared] != Verdict.UNSURE
    chosen = np.flatnonzero(known & (distances.shape <= voxel))
    at = distances.compared[chosen]
    cells = np.floor(distances.cores.points[at] / (_PATCH * voxel)).astype(np.int64)
    _, patch, size = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    members = np.split(np.argsort(patch, kind="stable"), np.cumsum(size)[:-1])
    large = [each for each in members if len(each) >= _FEWEST_IN_PATCH]
    sums = distances.cores.area[at] * distances.distance[at]
    some = large[:: max(1, -(-len(large) // _MOST_PATCHES))]
    off = [abs(sums[each].sum()) / distances.sigma_of_sum(chosen[each]) for each in some]
    return max(1.0, float(np.quantile(off, _UNCHANGED)) / _UNCHANGED_SIGMAS) if off else 1.0


def _shared(old: Epoch, new: Epoch, shares: tuple[Any, Any], alignment: np.ndarray | None) -> tuple[Any, np.ndarray]:
    """(m, n) the share that each of n common errors of six numbers has in a distance, of the shares of all scans in
    both layers; (6 n, 6 n) their covariance."""
    before, after = shares
    if alignment is None:
        scans, prior = after - before, old.covariance
    else:
        every = sparse.csr_array(np.ones((before.shape[0], 1)))
        scans = sparse.hstack([after, -before, every])
        prior = np.asarray(block_diag(new.covariance, old.covariance, alignment))
    return scans.tocsr(), prior


def _shape(old: Epoch, new: Epoch, cores: Cores, distance: np.ndarray, voxel: float) -> tuple[np.ndarray, np.ndarray]:
    """What two surveys see differently of edges and corners: where the two surfaces are not parallel, or points are far
    from their plane in both. A scour in a bed, or the bed where a heap lay, is a plane in one of them.
    (m,) the standard deviation of distances by that [m], and (m,) the squared tangent of the angle between the two."""
    one, rough = planes_at(old, cores.points, voxel)
    other, rough_after = planes_at(new, cores.points + distance[:, None] * cores.normals, voxel)
    tilt = np.clip(np.abs(np.einsum("ka,ka->k", one, other)), _LEAST_COSINE, 1.0) ** -2 - 1  # squared tangent
    beyond = np.maximum(np.fmin(rough, rough_after) / voxel - _PLANE, 0.0)
    return voxel * (beyond + tilt * (_TILTED + _TILTED_ROUGH * beyond)), tilt


def _doubtful(old: Epoch, new: Epoch, cores: Cores, distance: np.ndarray, voxel: float) -> np.ndarray:
    """(m,) bool: where surfaces far apart need not be one that changed. The survey that has the one behind has to have
    looked through the place of the one in front: it did not below a pontoon whose top the other survey saw, nor beside
    a ghost, nor at the other side of a thin wall. Of a cloud whose sides are not known no wall tells."""
    far = np.abs(distance) > _FAR * voxel
    result = far.copy()
    for chosen, behind in ((far & (distance > 0), old), (far & (distance < 0), new)):
        front = cores.points[chosen] + np.maximum(distance[chosen], 0.0)[:, None] * cores.normals[chosen]
        result[chosen] = ~behind.passes(front, voxel)
    if not (old.sides_known and new.sides_known):
        result |= far & (np.abs(cores.normals[:, 2]) < _STEEP)
    return result


def _columns(cores: Cores) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return cores.points, cores.normals, cores.area


def _lifted(scans: Any, lever: np.ndarray) -> Any:
    """(m, 6 n): the shares of n scans (m, n), each times the lever (m, 6) of its row."""
    row = np.repeat(np.arange(scans.shape[0]), np.diff(scans.indptr))
    data = (scans.data[:, None] * lever[row]).ravel()
    indices = (6 * scans.indices[:, None].astype(np.int64) + np.arange(6)).ravel()
    return sparse.csr_array(
        (data, indices, 6 * scans.indptr.astype(np.int64)), shape=(scans.shape[0], 6 * scans.shape[1])
    )


def _common_errors(
    measured: np.ndarray, noise: np.ndarray, shared: Any, prior: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The errors (s,) of poses and alignment that explain most distances (m,), and their covariance (s, s)."""
    errors, covariance = np.zeros(len(prior)), prior
    for _ in range(_ROUNDS):
        scale = np.sqrt(_SHARED * noise + _spread(shared, covariance))
        away = np.clip((measured + shared @ errors) / (_BIWEIGHT * scale), -1, 1)
        weighted = shared.multiply(((1 - away**2) ** 2 / (_SHARED * OVERLAP * noise))[:, None]).tocsr()
        covariance = np.linalg.solve(np.eye(len(prior)) + prior @ (shared.T @ weighted).toarray(), prior)
        errors = -covariance @ (weighted.T @ measured)
    return errors, covariance


def _spread(shared: Any, covariance: np.ndarray) -> np.ndarray:
    """(m,) the variance of each distance by the common errors [m^2]."""
    total = np.empty(shared.shape[0])
    for start in range(0, len(total), _CHUNK):
        rows = shared[start : start + _CHUNK]
        total[start : start + _CHUNK] = np.maximum(rows.multiply(rows @ covariance).sum(axis=1), 0.0)
    return total


_HIDDEN = 3**-0.5  # root mean square of a height of which nothing is known but that it is from 0 to 1
_JOINED = 2.0  # [voxels] between neighbors, and how far around significant ones the volume counts
# One core point of twenty is significant by chance, and its neighbors share its points. So a region has more than a
# cylinder holds, and its volume is beyond so many sigmas in a map of so many core points; in a larger one beyond more,
# as it has more places for chance.
_FEWEST = 12
_SIGMAS = 3.3
_USUAL_COUNT = 12_000


@dataclass(frozen=True, slots=True)
class Region:
    gained: bool
    volume: float  # sum of area times distance [m^3], negative where lost; its rim counts, where changes fade out
    # standard deviation of the volume [m^3]: its own, and what is unseen, as if it changed by the largest distance
    sigma: float
    unseen: float  # what of the old surface in it and at its rim cannot be said, and is not in the volume [m^2]
    area: float  # of the core points whose own distance is significant [m^2]
    height: float  # mean distance of these along the normal [m], negative where lost
    members: np.ndarray  # (k,) int64, these, by their number among the core points
    place: np.ndarray  # (3,) mean of these [m], frame of the old map
    # (3,) lowest and highest coordinates of these [m]
    low: np.ndarray
    high: np.ndarray

    @property
    def as_json(self) -> Mapping[str, Any]:
        return {
            "kind": "gained" if self.gained else "lost",
            "area_m2": self.area,
            "height_m": self.height,
            "volume_m3": self.volume,
            "volume_sigma_m3": self.sigma,
            "unseen_m2": self.unseen,
            "core_points": len(self.members),
            "place_m": self.place.tolist(),
            "lowest_m": self.low.tolist(),
            "highest_m": self.high.tolist(),
        }


def regions_of(distances: Distances) -> Sequence[Region]:
    """The regions that changed, the largest volume first."""
    found: list[Region] = []
    every = distances.cores.points[distances.compared]
    distance = distances.distance[distances.compared]
    verdict = distances.verdict[distances.compared]
    clusters = [
        cluster
        for kind in (Verdict.GAINED, Verdict.LOST)
        for cluster in _clusters(every, verdict == kind, distances.voxel)
    ]
    least = np.sqrt(_SIGMAS**2 + 2 * np.log(max(len(every) / _USUAL_COUNT, 1.0)))
    owner = np.full(len(every), -1)
    if clusters:
        seeds = np.concatenate(clusters)
        near, which = KDTree(every[seeds]).query(every, distance_upper_bound=_JOINED * distances.voxel)
        # others say nothing of a volume
        within = np.isfinite(near) & (verdict != Verdict.UNSURE) & (distances.shape <= distances.voxel)
        owner[within] = np.repeat(np.arange(len(clusters)), [len(cluster) for cluster in clusters])[
            np.asarray(which)[within]
        ]
    for number, cluster in enumerate(clusters):
        around = np.flatnonzero(owner == number)
        area = distances.cores.area[distances.compared]
        volume, sigma = float(area[around] @ distance[around]), distances.sigma_of_sum(around)
        gained = bool(verdict[cluster[0]] == Verdict.GAINED)
        if abs(volume) <= least * sigma or (volume > 0) != gained:
            continue
        points, own = every[cluster], area[cluster]
        unseen = _unseen(distances, distances.compared[cluster])
        found.append(
            Region(
                gained=gained,
                volume=volume,
                sigma=float(np.hypot(sigma, _HIDDEN * unseen * np.abs(distance[cluster]).max())),
                unseen=unseen,
                area=float(own.sum()),
                height=float(own @ distance[cluster] / own.sum()),
                members=distances.compared[cluster],
                place=points.mean(axis=0),
                low=points.min(axis=0),
                high=points.max(axis=0),
            )
        )
    return sorted(found, key=lambda region: -abs(region.volume))


def _unseen(distances: Distances, members: np.ndarray) -> float:
    """The area [m^2], seen along their normal, among and around core points (k,) of which nothing can be said."""
    cores = distances.cores
    unknown = cores.take(np.isin(distances.verdict, (Verdict.OLD_ONLY, Verdict.NEW_ONLY, Verdict.UNSURE)))
    around = max(_JOINED * distances.voxel, float(np.sqrt(cores.area[members].sum() / np.pi)))
    near = np.isfinite(KDTree(cores.points[members]).query(unknown.points, distance_upper_bound=around)[0])
    normal = cores.normals[members].mean(axis=0)
    return float(unknown.area[near] @ np.abs(unknown.normals[near] @ normal) / np.linalg.norm(normal))


def _clusters(points: np.ndarray, chosen: np.ndarray, voxel: float) -> list[np.ndarray]:
    """The chosen points (m,) bool in groups of neighbors that are large enough, each by their numbers."""
    numbers = np.flatnonzero(chosen)
    pairs = KDTree(points[numbers]).query_pairs(_JOINED * voxel, output_type="ndarray")
    linked = sparse.coo_array((np.ones(len(pairs)), pairs.T), shape=(len(numbers), len(numbers)))
    group = connected_components(linked, directed=False)[1]
    large = np.flatnonzero(np.bincount(group, minlength=1) >= _FEWEST)
    return [numbers[group == each] for each in large.tolist()]
