"""Parts of a pose graph about edges that contradict the others: what is wrong there concerns no pose far away."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from sonarmap.slam.graph.pose_graph import PoseGraph


@dataclass(frozen=True, slots=True)
class Region:
    """A part of a graph, as a graph of its own."""

    graph: PoseGraph  # of the region's poses; those at its rim are held where they were
    edges: np.ndarray  # the number that each of its edges has in the whole graph


def regions_about(graph: PoseGraph, active: np.ndarray, doubtful: Sequence[int], size: int) -> list[Region]:
    """The regions of `size` poses around each end of doubtful edges; those that touch are one.

    Of a graph whose poses are about where they are; its active edges, (E,) bool, join them.
    """
    ends = np.array([(edge.i, edge.j) for edge in graph.edges])
    count, joining = len(graph.trajectory), np.flatnonzero(active)
    rows, columns = np.concatenate([ends[joining], ends[joining, ::-1]]).T
    joined = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    inside = np.zeros(count, bool)
    for pose in np.unique(ends[list(doubtful)]).tolist():
        inside[_around(joined, pose, size)] = True
    poses = np.flatnonzero(inside)
    # pyrefly: ignore[bad-index]
    _, place = connected_components(joined[poses][:, poses], directed=False)
    groups = np.split(poses[np.argsort(place, kind="stable")], np.cumsum(np.bincount(place))[:-1])
    return [_region(graph, ends, joining, group) for group in groups]


def _around(joined: sparse.csr_array, pose: int, size: int) -> list[int]:
    """The poses that are the fewest edges away."""
    reached, waiting = {pose}, deque([pose])
    while waiting and len(reached) < size:
        k = waiting.popleft()
        new = [other for other in joined.indices[joined.indptr[k] : joined.indptr[k + 1]] if other not in reached]
        reached.update(new)
        waiting.extend(new)
    return list(reached)


def _region(graph: PoseGraph, ends: np.ndarray, joining: np.ndarray, poses: np.ndarray) -> Region:
    inside = np.zeros(len(graph.trajectory), bool)
    inside[poses] = True
    touching = inside[ends[joining]]
    number = np.cumsum(inside) - 1
    chosen = joining[touching.all(axis=1)]
    leaving = ends[joining[touching.any(axis=1) & ~touching.all(axis=1)]]
    rim = set(leaving[inside[leaving]].tolist())

    def own(k: int) -> int:
        return int(number[k])

    return Region(
        PoseGraph(
            graph.trajectory.take(poses.tolist()),
            tuple(replace(graph.edges[k], i=own(graph.edges[k].i), j=own(graph.edges[k].j)) for k in chosen.tolist()),
            fixed=tuple(sorted(own(k) for k in rim.union(k for k in graph.fixed if inside[k]))),
            priors=tuple((own(k), prior) for k, prior in graph.priors if inside[k]),
            known=tuple(replace(known, pose=own(known.pose)) for known in graph.known if inside[known.pose]),
            control=tuple(replace(point, scan=own(point.scan)) for point in graph.control if inside[point.scan]),
        ),
        chosen,
    )
