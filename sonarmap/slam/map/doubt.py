"""Points that too few scans saw where others looked: false echoes, most of them.

That a scan saw a point alone speaks against it only where others looked. These are the three ways in which what they
saw, or what the scan itself saw around, then contradicts it:

- passed: at least as many scans saw something farther off in its direction as something there;
- behind: its own scan saw something nearer all around it. Sound does not come from behind what reflects it: the
  echo took a detour over a mirror, or is a wild one. About an edge or a slope there are farther echoes;
- beside: a surface that twice as many scans saw passes by, and none of its points is near: the fringe of noise.

Distances are in voxels, and nothing else is compared with a constant: in sparse scans, at a survey's rim and in a
single pass all points are seen as seldom as those around them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.map.cell import cell_keys, lattice_origin
from sonarmap.slam.map.free_space import Votes
from sonarmap.slam.map.point_map import PointMap

MIN_SEEN = 2  # scans that have to see a point where others looked, unless the user says how many
_AROUND, _NEIGHBORS = 2.0, 12  # the surface about a point: so far [voxels], and so many of its points at most
_OFTEN = 2  # a surface was seen well if it was seen so many times as often as the point beside it
_NEAR = 0.75  # a point this near to what was seen well is part of it [voxels]
_AT_A_TIME = 100_000  # points that are looked at together, so that memory stays small


@dataclass(frozen=True, slots=True)
class CleanMap:
    """A map in two layers.

    Attributes:
        clean: the map.
        doubtful: the points that were left out of it.
    """

    clean: PointMap
    doubtful: PointMap


def part_doubtful(point_map: PointMap, vote: Votes, min_seen: int = MIN_SEEN) -> CleanMap:
    """Take out what fewer than `min_seen` scans saw and others contradict; 1 takes out nothing.

    Args:
        point_map: what free space left.
        vote: about its points.
        min_seen: points that as many scans saw all stay.
    """
    asked = replace(point_map, looked=vote.looked)
    few = (point_map.seen < min_seen) & (vote.looked > point_map.seen)
    doubtful = few & (vote.behind | (vote.contradict > 0) & (vote.contradict >= vote.agree))
    rest = np.flatnonzero(few & ~doubtful)
    doubtful[rest] = _beside(point_map, rest)
    if doubtful.all():  # nothing is left that could contradict it
        doubtful[:] = False
    count = int(np.count_nonzero(doubtful))
    return CleanMap(replace(asked.take(~doubtful), doubted=count), asked.take(doubtful))


def _beside(point_map: PointMap, chosen: np.ndarray) -> np.ndarray:
    """Which of the `chosen` points (n,) lie beside a surface that was seen well, (n,) bool."""
    beside = np.zeros(len(chosen), bool)
    if not len(chosen):
        return beside
    # one query of few points: what balancing costs it does not save
    tree = KDTree(point_map.points, leafsize=32, compact_nodes=False, balanced_tree=False)
    seen = np.append(point_map.seen, 0)  # the last stands for neighbors that there are not
    for first in range(0, len(chosen), _AT_A_TIME):
        some = slice(first, first + _AT_A_TIME)
        places = point_map.points[chosen[some]]
        distance, near = tree.query(
            places, _NEIGHBORS + 1, distance_upper_bound=_AROUND * point_map.voxel
        )  # the first is the point itself
        around, count = seen[np.asarray(near)[:, 1:]], np.isfinite(distance[:, 1:]).sum(axis=1)
        well = _OFTEN * point_map.seen[chosen[some]]
        part_of = ((around >= well[:, None]) & (distance[:, 1:] <= _NEAR * point_map.voxel)).any(axis=1)
        beside[some] = (around.sum(axis=1) >= well * count) & (count > 0) & ~part_of
    return beside


def of_the_same_echoes(
    point_map: PointMap, clean: PointMap, T_here: RigidTransform, T_clean: RigidTransform, indices: Sequence[int]
) -> PointMap:
    """A map of the same scans by other poses, with the points that a clean map has: for pictures of both.

    A point of several scans stays. One that a scan alone saw is moved with its scan to where it lies in the clean
    map, and stays if it meets a point there.

    Args:
        point_map: the map to clean.
        clean: what is left of the other map.
        T_here, T_clean: T_world_sensor of the S scans in both maps.
        indices: what the maps call the scans, ascending.
    """
    alone = np.flatnonzero(point_map.seen == 1)
    scan = np.searchsorted(np.asarray(indices), point_map.scan[alone])
    moved = (T_clean * T_here.inv())[scan].apply(point_map.points[alone])
    origin = lattice_origin(clean.points, clean.voxel)
    keys, near = cell_keys(moved, clean.voxel, origin)
    met = np.zeros(len(alone), bool)
    met[near] = np.isin(keys, cell_keys(clean.points, clean.voxel, origin)[0])
    kept = np.ones(len(point_map.points), bool)
    kept[alone[~met]] = False
    return point_map.take(kept)
