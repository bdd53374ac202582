"""All maps of one component: of all its scans, and of each survey alone.

Points that too few scans saw where others looked, false echoes most of them, are apart from the map. That a scan saw a
point alone speaks against it only where others looked. These are the three ways in which what they saw, or what the
scan itself saw around, then contradicts it:

- passed: at least as many scans saw something farther off in its direction as something there;
- behind: its own scan saw something nearer all around it. Sound does not come from behind what reflects it: the
  echo took a detour over a mirror, or is a wild one. About an edge or a slope there are farther echoes;
- beside: a surface that twice as many scans saw passes by, and none of its points is near: the fringe of noise.

Distances are in voxels, and nothing else is compared with a constant: in sparse scans, at a survey's rim and in a
single pass all points are seen as seldom as those around them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from sonarmap.slam.execute.executor import Executor
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.map.crossing import CrossingError, crossing_error
from sonarmap.slam.map.free_space import Votes, uncontradicted, votes
from sonarmap.slam.map.placed import PlacedScans
from sonarmap.slam.map.point_map import PointMap, fuse

MIN_SEEN = 2  # scans that have to see a point where others looked, unless the user says how many
_SURFACE_RADIUS = 2.0  # of the surface about a point [voxels]
_SURFACE_POINTS = 12  # of it, at most
_SEEN_RATIO = 2  # a surface was seen well if more scans than this ratio saw it for each that saw the point beside it
_NEAR = 0.75  # a point this near to what was seen well is part of it [voxels]
_AT_A_TIME = 100_000  # points that are looked at together, so that memory stays small


@dataclass(frozen=True, slots=True)
class CleanMap:
    clean: PointMap  # the map
    doubtful: PointMap  # the points that were left out of it


@dataclass(frozen=True, slots=True)
class ComponentMaps:
    """The maps of n scans that edges join."""

    optimized: PointMap  # the map
    # the points that were left out of it, as too few scans saw them where others looked; None where that was not asked
    doubtful: PointMap | None
    # the map of each survey's scans alone, by the survey's number, and what is doubtful by these scans; none where
    # there is one survey. In the map of all, a survey may contradict what an earlier one saw
    # and what has changed since: a layer is the place as that survey found it
    layers: Mapping[int, CleanMap]
    crossings: CrossingError  # how far overlapping passes lie apart, before and after


def component_maps(
    placed: PlacedScans, chained: Trajectory, min_seen: int = MIN_SEEN, executor: Executor | None = None
) -> ComponentMaps:
    """Fuse one component.

    Args:
        placed: n scans at their optimized poses, their indices ascending.
        chained: their n poses before the loops, in the same frame.
        min_seen: scans that have to see a point where others looked; 1 leaves nothing out.
        executor: who asks the scans about the points; None for this process.
    """
    layers = {number: clean_map(scans, min_seen, executor) for number, scans in placed.by_survey.items()}
    parted, asked = clean_map(placed, min_seen, executor), min_seen > 1
    return ComponentMaps(
        optimized=parted.clean,
        doubtful=parted.doubtful if asked else None,
        layers=layers,
        crossings=crossing_error(placed, chained.T_world_sensor),
    )


def clean_map(placed: PlacedScans, min_seen: int = MIN_SEEN, executor: Executor | None = None) -> CleanMap:
    """Fuse scans, take out what free space contradicts, and part what too few scans saw where others looked."""
    fused = fuse(placed)
    vote = votes(fused, placed, executor)
    kept = uncontradicted(fused, vote)
    cleared = replace(fused.take(kept), removed=int(np.count_nonzero(~kept)))
    return part_doubtful(cleared, vote.take(kept), min_seen)


def part_doubtful(point_map: PointMap, vote: Votes, min_seen: int = MIN_SEEN) -> CleanMap:
    """Take out what fewer than `min_seen` scans saw and others contradict, of what free space left; 1 takes out
    nothing."""
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
            places, _SURFACE_POINTS + 1, distance_upper_bound=_SURFACE_RADIUS * point_map.voxel
        )  # the first is the point itself
        around, count = seen[np.asarray(near)[:, 1:]], np.isfinite(distance[:, 1:]).sum(axis=1)
        well = _SEEN_RATIO * point_map.seen[chosen[some]]
        part_of = ((around >= well[:, None]) & (distance[:, 1:] <= _NEAR * point_map.voxel)).any(axis=1)
        beside[some] = (around.sum(axis=1) >= well * count) & (count > 0) & ~part_of
    return beside
