"""Distances between two surveys with their levels of detection, the verdict on each core point, and changed regions.

Errors of the poses and of the alignment shift whole areas of a surface. Most of a place does not change between two
surveys, so these errors are estimated from all distances together, with their covariances as prior and Tukey's biweight
against outliers. Their remaining covariance, noise and roughness make up the level of detection.
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

_LEVEL = 1.96  # level of detection at 95 % [sigmas]
# From simulated pairs of surveys (docs/measured). At edges and corners the sigma of a distance is the roughness beyond
# _PLANE, plus tan^2 of the angle between both planes times (_TILTED + _TILTED_ROUGH times that roughness) [voxels].
_NOISE = 0.5  # variance of a mean, relative to that by the scatter of its points: a map's points lie in voxels
_PLANE, _TILTED, _TILTED_ROUGH = 0.3, 0.7, 6.0
_ERRING, _LEAST_COSINE = 0.05, 0.1  # largest squared tangent of a normal's error by noise; bound on a cosine
_SHARED = 4.0  # factor on the noise in the estimate of the poses, for differences between viewpoints
OVERLAP = np.pi * RADIUS**2  # number of core points whose cylinders share their points
_BIWEIGHT, _ROUNDS = 4.0, 8  # largest distance that counts [sigmas]; iterations of the weights
_MEDIAN = 0.6745  # of |x| / sigma of a normal distribution
# Sums over patches measure correlated errors that are not modeled; a third of the patches may have changed.
_PATCH, _FEWEST_IN_PATCH, _MOST_PATCHES = 6.0, 12, 500  # edge [voxels], numbers of core points and of patches
_UNCHANGED, _UNCHANGED_SIGMAS = 2 / 3, 0.9674  # quantile of the patches' sums, and its value for normal errors
_FAR = 1.75  # smallest distance at which two surfaces cannot be confused [voxels]
_STEEP = 0.5  # largest upward part of a wall's normal; a cloud may show the wall's other side
_CHUNK = 20_000  # core points that are treated at a time


class Verdict(IntEnum):
    """Verdict on a core point."""

    UNCHANGED = 0  # the distance is below its level of detection, which is below the bound
    GAINED = 1  # the new surface is nearer to the sensor by more than the level of detection
    LOST = 2  # the new surface is farther from the sensor by more than the level of detection
    UNSURE = 3  # the distance is below the level, which is above the bound; or two surfaces may be different ones
    OLD_ONLY = 4  # the new survey has no surface there: not seen, hidden, too few points, or farther than the reach
    NEW_ONLY = 5  # the old survey has no surface there


@dataclass(frozen=True, slots=True)
class Distances:
    """Distances at K core points, those of verdict NEW_ONLY last."""

    cores: Cores  # in the frame of the old map
    distance: np.ndarray  # (K,) float64 along the normal [m], positive where the surface was gained; NaN where unknown
    level: np.ndarray  # (K,) float64 level of detection at 95 % [m]; NaN where unknown
    verdict: np.ndarray  # (K,) int64, of Verdict
    compared: np.ndarray  # (m,) int64, indices of the core points that both surveys have
    noise: np.ndarray  # (m,) variance of noise, correlated only between overlapping cylinders [m^2]
    shape: np.ndarray  # (m,) standard deviation by surfaces that are not planes, correlated between neighbors [m]
    shared: Any  # sparse (m, s) derivatives of the distances by the s common errors
    covariance: np.ndarray  # (s, s) of the common errors
    widened: float  # factor on all sigmas, from the scatter of the distances
    voxel: float  # [m]
    together: float = 1.0  # further factor on sigmas of sums, for correlated errors such as those of distorted scans

    @property
    def sigma(self) -> np.ndarray:
        """(K,) standard deviation of the distance [m]."""
        return self.level / _LEVEL

    def sigma_of_sum(self, chosen: np.ndarray) -> float:
        """Standard deviation of the volume [m^3], the sum of area times distance, of the `chosen` ones of the m core
        points. Common errors are fully correlated, and noise as far as cylinders overlap."""
        area = self.cores.area[self.compared[chosen]]
        J = self.shared[chosen].T @ area
        overlap = np.minimum(np.pi * (RADIUS * self.voxel) ** 2 / area, len(area))
        local = (area**2 * self.noise[chosen] * overlap).sum() + (area @ self.shape[chosen]) ** 2
        return self.together * self.widened * float(np.sqrt(J @ self.covariance @ J + local))


def distances_between(
    old: Epoch, new: Epoch, alignment: np.ndarray | None, voxel: float, reach: float, bound: float
) -> Distances:
    """Distances from the old surface to the new one, both in the old map's frame.

    Args:
        alignment: (6, 6) covariance of the new frame in the old one [rad, m], left tangent; None for one map.
        voxel: unit of all radii [m].
        reach: range along the normal in which the new surface is sought [m].
        bound: largest level of detection of an unchanged core point [m].
    """
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
    # with an error of the normal, a shift along the surface appears as a distance
    shift = [_lifted(scans, levers(points, np.tile(axis, (len(both), 1)))) @ errors for axis in np.eye(3)]
    tangential = np.square(shift).sum(axis=0) - (shared @ errors) ** 2
    shape = np.sqrt(shape**2 + np.maximum(tangential, 0.0) * np.minimum(tilt, _ERRING))
    sigma = np.sqrt(noise + shape**2 + _spread(shared, covariance))
    widened = max(1.0, float(np.median(np.abs(moved) / sigma)) / _MEDIAN) if len(both) else 1.0
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
    """Factor by which sums over patches exceed their sigmas, because neighbors' errors are correlated; at least 1."""
    voxel, known = distances.voxel, distances.verdict[distances.compared] != Verdict.UNSURE
    chosen = np.flatnonzero(known & (distances.shape <= voxel))
    at = distances.compared[chosen]
    cells = np.floor(distances.cores.points[at] / (_PATCH * voxel)).astype(np.int64)
    _, patch, size = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    members = np.split(np.argsort(patch, kind="stable"), np.cumsum(size)[:-1])
    large = [indices for indices in members if len(indices) >= _FEWEST_IN_PATCH]
    volumes = distances.cores.area[at] * distances.distance[at]
    some = large[:: max(1, -(-len(large) // _MOST_PATCHES))]
    ratios = [abs(volumes[indices].sum()) / distances.sigma_of_sum(chosen[indices]) for indices in some]
    return max(1.0, float(np.quantile(ratios, _UNCHANGED)) / _UNCHANGED_SIGMAS) if ratios else 1.0


def _shared(old: Epoch, new: Epoch, shares: tuple[Any, Any], alignment: np.ndarray | None) -> tuple[Any, np.ndarray]:
    """(m, n) share of each of n common errors in a distance, from the shares of the scans in both layers; and the
    covariance (6 n, 6 n) of these errors of six numbers each."""
    before, after = shares
    if alignment is None:
        scans, prior = after - before, old.covariance
    else:
        every = sparse.csr_array(np.ones((before.shape[0], 1)))
        scans = sparse.hstack([after, -before, every])
        prior = np.asarray(block_diag(new.covariance, old.covariance, alignment))
    return scans.tocsr(), prior


def _shape(old: Epoch, new: Epoch, cores: Cores, distance: np.ndarray, voxel: float) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations of distances at edges and corners (m,) [m], and squared tangents of the angles between both
    surfaces (m,). Two surveys see a place differently where their surfaces are not parallel, or planes in neither: a
    scour in a bed is a plane in one of them."""
    normal, rough = planes_at(old, cores.points, voxel)
    normal_after, rough_after = planes_at(new, cores.points + distance[:, None] * cores.normals, voxel)
    tilt = np.clip(np.abs(np.einsum("ka,ka->k", normal, normal_after)), _LEAST_COSINE, 1.0) ** -2 - 1
    beyond = np.maximum(np.fmin(rough, rough_after) / voxel - _PLANE, 0.0)
    return voxel * (beyond + tilt * (_TILTED + _TILTED_ROUGH * beyond)), tilt


def _doubtful(old: Epoch, new: Epoch, cores: Cores, distance: np.ndarray, voxel: float) -> np.ndarray:
    """(m,) bool: where two distant surfaces may be different ones instead of one that changed. The survey with the
    surface behind must have seen the place of the one in front free: not if the other saw the top of a pontoon, a
    ghost, or the other side of a thin wall. Walls of clouds without viewpoints are doubtful."""
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
    """(m, 6 n): the shares (m, n) of n scans, each multiplied by the lever (m, 6) of its row."""
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
    """(m,) variances of the distances by the common errors [m^2]."""
    total = np.empty(shared.shape[0])
    for start in range(0, len(total), _CHUNK):
        rows = shared[start : start + _CHUNK]
        total[start : start + _CHUNK] = np.maximum(rows.multiply(rows @ covariance).sum(axis=1), 0.0)
    return total


_HIDDEN = 3**-0.5  # root mean square of a height distributed uniformly from 0 to 1
_JOINED = 2.0  # largest distance between neighbors, and from significant points to the rim of a region [voxels]
# One core point in twenty is significant by chance, and its neighbors share its points, so a region needs more core
# points than a cylinder holds, and a volume beyond _SIGMAS in a map of _USUAL_COUNT core points; in a larger map more.
_FEWEST = 12  # least number of core points of a region
_SIGMAS = 3.3
_USUAL_COUNT = 12_000


@dataclass(frozen=True, slots=True)
class Region:
    """A connected region of k core points with significant distances of one sign, and its rim."""

    gained: bool
    volume: float  # sum of area times distance [m^3], with the rim; negative where lost
    sigma: float  # standard deviation of the volume [m^3], with changes of unseen areas up to the largest distance
    unseen: float  # area without verdict in the region and at its rim, not in the volume [m^2]
    area: float  # of the k core points [m^2]
    height: float  # mean distance of the k core points along the normal [m], negative where lost
    members: np.ndarray  # (k,) int64 indices of the core points
    place: np.ndarray  # (3,) mean of the core points [m], in the frame of the old map
    # (3,) lowest and highest coordinates of the core points [m]
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
    """The changed regions, the largest volume first."""
    regions: list[Region] = []
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
        # the volume is summed over core points with a verdict and a well-defined shape
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
        points, areas = every[cluster], area[cluster]
        unseen = _unseen(distances, distances.compared[cluster])
        regions.append(
            Region(
                gained=gained,
                volume=volume,
                sigma=float(np.hypot(sigma, _HIDDEN * unseen * np.abs(distance[cluster]).max())),
                unseen=unseen,
                area=float(areas.sum()),
                height=float(areas @ distance[cluster] / areas.sum()),
                members=distances.compared[cluster],
                place=points.mean(axis=0),
                low=points.min(axis=0),
                high=points.max(axis=0),
            )
        )
    return sorted(regions, key=lambda region: -abs(region.volume))


def _unseen(distances: Distances, members: np.ndarray) -> float:
    """Area without verdict among and around the core points `members` (k,) [m^2], projected along their normal."""
    cores = distances.cores
    unknown = cores.take(np.isin(distances.verdict, (Verdict.OLD_ONLY, Verdict.NEW_ONLY, Verdict.UNSURE)))
    around = max(_JOINED * distances.voxel, float(np.sqrt(cores.area[members].sum() / np.pi)))
    near = np.isfinite(KDTree(cores.points[members]).query(unknown.points, distance_upper_bound=around)[0])
    normal = cores.normals[members].mean(axis=0)
    return float(unknown.area[near] @ np.abs(unknown.normals[near] @ normal) / np.linalg.norm(normal))


def _clusters(points: np.ndarray, chosen: np.ndarray, voxel: float) -> list[np.ndarray]:
    """Connected groups of at least _FEWEST of the `chosen` points (m,) bool, as indices."""
    numbers = np.flatnonzero(chosen)
    pairs = KDTree(points[numbers]).query_pairs(_JOINED * voxel, output_type="ndarray")
    linked = sparse.coo_array((np.ones(len(pairs)), pairs.T), shape=(len(numbers), len(numbers)))
    group = connected_components(linked, directed=False)[1]
    large = np.flatnonzero(np.bincount(group, minlength=1) >= _FEWEST)
    return [numbers[group == label] for label in large.tolist()]
