"""Regions that changed: neighboring core points with significant distances of one sign, significant as a whole."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from sonarmap.tools.products.compare.distances import Distances, Verdict

_HIDDEN = 3**-0.5  # root mean square of a height of which nothing is known but that it is from 0 to 1
_JOINED = 2.0  # [voxels] between neighbors, and how far around significant ones the volume counts
# One core point of twenty is significant by chance, and its neighbors share its points. So a region has more than a
# cylinder holds, and its volume is beyond so many sigmas in a map of so many core points; in a larger one beyond more,
# as it has more places for chance.
_FEWEST, _SIGMAS, _USUAL = 12, 3.3, 12_000


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
    least = np.sqrt(_SIGMAS**2 + 2 * np.log(max(len(every) / _USUAL, 1.0)))
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
