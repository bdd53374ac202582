"""The maps of one component: of all its scans, and of each survey alone.

Doubtful points, most of them false echoes, are kept apart from the map. Too few scans saw them although others looked
there, and they are contradicted in one of three ways:

- passed: at least as many scans saw something farther off in its direction as saw something there;
- behind: its own scan saw something nearer all around it. Sound does not come from behind what reflects it: the
  echo took a detour over a mirror, or is a false one. Around an edge or a slope there are farther echoes;
- beside: it lies next to a surface that twice as many scans saw, but not on it: the fringe of noise.

Distances are in voxels, and other thresholds are relative: in sparse scans, at a survey's rim and in a single pass all
points are seen as seldom as those around them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.map.crossing import CrossingError, crossing_error
from sonarmap.slam.map.free_space import Votes, uncontradicted, votes
from sonarmap.slam.map.placed import PlacedScans
from sonarmap.slam.map.point_map import PointMap, fuse

MIN_SEEN = 2  # scans that have to see a point where others looked, by default
_SURFACE_RADIUS = 2.0  # up to which neighbors form the surface about a point [voxels]
_SURFACE_POINTS = 12  # largest number of these neighbors
_SEEN_RATIO = 2  # of the scans that saw a well-seen surface to those that saw the point beside it, at least
_NEAR = 0.75  # distance up to which a point is part of a well-seen surface [voxels]


@dataclass(frozen=True, slots=True)
class CleanMap:
    clean: PointMap  # the map
    doubtful: PointMap  # the points that were left out of it


@dataclass(frozen=True, slots=True)
class ComponentMaps:
    """The maps of a component of n scans."""

    optimized: PointMap  # the map of all scans
    doubtful: PointMap | None  # the doubtful points that were left out of it; None if `min_seen` is 1
    # maps of each survey's scans alone, by the survey's number; none if there is only one survey. In the map of all, a
    # survey may contradict what has changed since an earlier one; a layer shows the place as its survey saw it
    layers: Mapping[int, CleanMap]
    crossings: CrossingError  # distances between overlapping passes, before and after the optimization


def component_maps(placed: PlacedScans, chained: Trajectory, min_seen: int = MIN_SEEN) -> ComponentMaps:
    """Fuse one component.

    Args:
        placed: n scans at their optimized poses, their indices ascending.
        chained: their n poses before the loops, in the same frame.
        min_seen: scans that have to see a point where others looked; 1 leaves nothing out.
    """
    layers = {number: clean_map(scans, min_seen) for number, scans in placed.by_survey.items()}
    whole = clean_map(placed, min_seen)
    return ComponentMaps(
        optimized=whole.clean,
        doubtful=whole.doubtful if min_seen > 1 else None,
        layers=layers,
        crossings=crossing_error(placed, chained.T_world_sensor),
    )


def clean_map(placed: PlacedScans, min_seen: int = MIN_SEEN) -> CleanMap:
    """Fuse scans, remove points that free space contradicts, and separate doubtful ones."""
    fused = fuse(placed)
    vote = votes(fused, placed)
    kept = uncontradicted(fused, vote)
    cleared = replace(fused.take(kept), removed=int(np.count_nonzero(~kept)))
    return part_doubtful(cleared, vote.take(kept), min_seen)


def part_doubtful(point_map: PointMap, vote: Votes, min_seen: int = MIN_SEEN) -> CleanMap:
    """Separate points that fewer than `min_seen` scans saw and that are contradicted; 1 separates none."""
    voted = replace(point_map, looked=vote.looked)
    few = (point_map.seen < min_seen) & (vote.looked > point_map.seen)
    doubtful = few & (vote.behind | (vote.contradict > 0) & (vote.contradict >= vote.agree))
    rest = np.flatnonzero(few & ~doubtful)
    doubtful[rest] = _beside(point_map, rest)
    if doubtful.all():  # nothing would be left that could contradict them
        doubtful[:] = False
    count = int(np.count_nonzero(doubtful))
    return CleanMap(replace(voted.take(~doubtful), doubted=count), voted.take(doubtful))


def _beside(point_map: PointMap, chosen: np.ndarray) -> np.ndarray:
    """(n,) bool: which of the `chosen` points (n,) lie beside a well-seen surface."""
    if not len(chosen):
        return np.zeros(0, bool)
    # balancing the tree costs more than it saves in a query of few points
    tree = KDTree(point_map.points, leafsize=32, compact_nodes=False, balanced_tree=False)
    seen = np.append(point_map.seen, 0)  # the last stands for missing neighbors
    distance, near = tree.query(
        point_map.points[chosen], _SURFACE_POINTS + 1, distance_upper_bound=_SURFACE_RADIUS * point_map.voxel
    )  # the first is the point itself
    around, count = seen[np.asarray(near)[:, 1:]], np.isfinite(distance[:, 1:]).sum(axis=1)
    well = _SEEN_RATIO * point_map.seen[chosen]
    part_of = ((around >= well[:, None]) & (distance[:, 1:] <= _NEAR * point_map.voxel)).any(axis=1)
    return (around.sum(axis=1) >= well * count) & (count > 0) & ~part_of
