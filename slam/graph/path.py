"""Paths through a pose graph: which edges no path can avoid, and the most certain path between two poses."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import RigidTransform

from slam.graph.edge import Edge
from slam.graph.tangent import carried


def bridges(count: int, edges: Sequence[Edge], in_world: Sequence[int] = ()) -> set[int]:
    """The edges, by index, without which a component of `count` poses would fall apart (Tarjan, IPL 1974).

    Poses `in_world` hold together without edges.
    """
    neighbors: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for number, (one, other) in enumerate(pairwise(in_world), len(edges)):
        # twice, so that neither is necessary
        for index in (number, number + count):
            neighbors[one].append((other, index))
            neighbors[other].append((one, index))
    for index, edge in enumerate(edges):
        if edge.kind != "prior":
            neighbors[edge.i].append((edge.j, index))
            neighbors[edge.j].append((edge.i, index))
    order, low, necessary = [-1] * count, [0] * count, set[int]()
    reached = 0
    for root in range(count):
        if order[root] >= 0:
            continue
        order[root] = low[root] = reached = reached + 1
        path = [(root, -1, iter(neighbors[root]))]
        while path:
            pose, by, rest = path[-1]
            step = next(((other, index) for other, index in rest if index != by), None)
            if step is None:
                path.pop()
                if path:
                    before = path[-1][0]
                    low[before] = min(low[before], low[pose])
                    if low[pose] == order[pose]:
                        necessary.add(by)
            elif order[step[0]] >= 0:
                low[pose] = min(low[pose], order[step[0]])
            else:
                order[step[0]] = low[step[0]] = reached = reached + 1
                path.append((*step, iter(neighbors[step[0]])))
    return necessary


def surest_covariances(
    T: RigidTransform, edges: Sequence[Edge], pairs: np.ndarray, most_sources: int = 500
) -> np.ndarray:
    """Covariances of relative poses, along the one path of least variance: (m, 6, 6).

    Each is at least the covariance that all paths together give, to first order, and costs far less. Poses that no path
    joins have infinite variances.

    Args:
        T: N poses, T_world_sensor, as estimated.
        edges: measurements between them; priors are ignored.
        pairs: (m, 2) int, poses i and j; the covariance is of T_i_j, in the body tangent of j.
        most_sources: poses from which paths are searched at a time; bounds the memory.
    """
    between = [edge for edge in edges if edge.kind != "prior"]
    covariances = np.stack([edge.registration.covariance for edge in between])
    ends = np.array([(edge.i, edge.j) for edge in between])
    reach = np.linalg.norm(T.translation[ends[:, 0]] - T.translation[ends[:, 1]], axis=1).mean() or 1.0
    variance = np.trace(covariances[:, :3, :3], axis1=1, axis2=2) * reach**2
    variance += np.trace(covariances[:, 3:, 3:], axis1=1, axis2=2)
    best = _of_least(len(T), ends, variance)
    weights = sparse.csr_array((variance[best], ends[best].T), shape=(len(T), len(T)))
    index = {frozenset(ends[k].tolist()): k for k in best.tolist()}
    covariance = np.zeros((len(pairs), 6, 6))
    sources = np.unique(pairs[:, 0])
    for start in range(0, len(sources), most_sources):
        chosen = sources[start : start + most_sources]
        _, before = dijkstra(weights, directed=False, indices=chosen, return_predecessors=True)
        mine = np.flatnonzero(np.isin(pairs[:, 0], chosen))
        paths = [_path(before[np.searchsorted(chosen, i)], i, j, index) for i, j in pairs[mine].tolist()]
        for pair, path in zip(mine.tolist(), paths, strict=True):
            if path is None:
                covariance[pair] = np.diag(np.full(6, np.inf))
        steps = [(pair, edge) for pair, path in zip(mine.tolist(), paths, strict=True) for edge in path or ()]
        if steps:
            pair, edge = np.array(steps).T
            T_j_edge = T[pairs[pair, 1]].inv() * T[ends[edge, 1]]
            np.add.at(covariance, pair, carried(T_j_edge, covariances[edge]))
    return covariance


def _of_least(count: int, ends: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Of the edges between the same two poses the one of least variance."""
    low, high = ends.min(axis=1), ends.max(axis=1)
    order = np.lexsort((variance, low * count + high))
    key = (low * count + high)[order]
    return order[np.concatenate([[True], np.diff(key) != 0])]


def _path(before: np.ndarray, i: int, j: int, index: dict[frozenset[int], int]) -> list[int] | None:
    """The edges from j back to i; None where there is no path."""
    path = []
    while j != i:
        previous = int(before[j])
        if previous < 0:
            return None
        path.append(index[frozenset((previous, j))])
        j = previous
    return path
