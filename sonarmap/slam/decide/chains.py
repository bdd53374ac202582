"""Scans chained into parts by edges that are trusted: where each is in its part, and what error gathers on the way."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import Edge, components, spanning_tree
from sonarmap.slam.graph.tangent import propagated


@dataclass(frozen=True, slots=True)
class Chains:
    """Scans chained into parts, without a cycle.

    Attributes:
        part: (N,) int, the number of each scan's part, 0, 1, ... in the order of their first scans.
        T: N poses, each in the frame of its part's first scan [m].
        spread: (N, 6, 6) covariance that gathers from the part's first scan to each, of a tangent in the part's frame
            (on the left), rotation first [rad, m].
        ways: where the ways from the first scan to others divide.
    """

    part: np.ndarray
    T: RigidTransform
    spread: np.ndarray
    ways: "Ways"

    def between(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """(m, 6, 6) what gathers on the way from scans i to scans j of their part."""
        return self.spread[i] + self.spread[j] - 2 * self.spread[self.ways.meeting(i, j)]


@dataclass(frozen=True, slots=True)
class Ways:
    """A forest, numbered so that every scan comes before those behind it, and all behind it follow in a row.

    Attributes:
        rank: (N,) int, the place of each scan in this order.
        scan: (N,) int, the scan at each place.
        before: (levels, N) int: at [l, k] the lowest place that any of the 2^l scans from place k on is reached from.
    """

    rank: np.ndarray
    scan: np.ndarray
    before: np.ndarray

    @classmethod
    def of(cls, order: Sequence[int], reached_from: np.ndarray) -> "Ways":
        """Of scans in this order, and (N,) the scan that each is reached from, itself for the first of a part."""
        scan = np.asarray(order, np.intp)
        rank = np.empty(len(scan), np.intp)
        rank[scan] = np.arange(len(scan))
        levels = [rank[reached_from[scan]]]
        while 2 ** len(levels) <= len(scan):
            half, last = 2 ** (len(levels) - 1), levels[-1]
            levels.append(np.minimum(last, np.concatenate([last[half:], last[-1:].repeat(half)])))
        return cls(rank, scan, np.stack(levels))

    def meeting(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """(m,) the last scan that lies on the ways from the first to i and to j, all of one part.

        Of the scans between both in the order, the one that is reached from farthest ahead is reached from it.
        """
        low, high = np.minimum(self.rank[i], self.rank[j]), np.maximum(self.rank[i], self.rank[j])
        level = np.frexp(np.maximum(high - low, 1))[1] - 1
        lowest = np.minimum(self.before[level, np.minimum(low + 1, high)], self.before[level, high - 2**level + 1])
        return self.scan[np.where(low == high, low, lowest)]


def chain_parts(count: int, edges: Sequence[Edge]) -> Chains:
    """The parts of `count` scans that edges join, each chained along a spanning tree from its first scan on."""
    tree = spanning_tree(count, edges)
    neighbors: dict[int, list[tuple[int, int, bool]]] = defaultdict(list)
    for n, edge in enumerate(tree):
        neighbors[edge.i].append((edge.j, n, True))
        neighbors[edge.j].append((edge.i, n, False))
    steps = RigidTransform.concatenate([e.registration.T_target_source for e in tree] or [RigidTransform.identity()])
    forward, back = steps.as_matrix(), steps.inv().as_matrix()
    part, T = np.empty(count, np.intp), np.tile(np.eye(4), (count, 1, 1))
    reached_from, along = np.arange(count), np.zeros(count, np.intp)
    order: list[int] = []
    for number, members in enumerate(components(count, edges)):
        part[list(members)] = number
        waiting = [members[0]]
        while waiting:
            i = waiting.pop()
            order.append(i)
            for j, n, is_forward in neighbors[i]:
                if j != reached_from[i]:
                    T[j] = T[i] @ (forward if is_forward else back)[n]
                    reached_from[j], along[j] = i, n
                    waiting.append(j)
    poses = RigidTransform.from_matrix(T)
    return Chains(part, poses, _spread(poses, tree, order, reached_from, along), Ways.of(order, reached_from))


def _spread(
    poses: RigidTransform, tree: Sequence[Edge], order: Sequence[int], reached_from: np.ndarray, along: np.ndarray
) -> np.ndarray:
    """(N, 6, 6) what gathers on the way to each, by the edge `along` which it is reached."""
    spread = np.zeros((len(poses), 6, 6))
    behind = np.flatnonzero(reached_from != np.arange(len(poses)))
    if not len(behind):
        return spread
    # the noise is on the side of the measured pair's source
    sources = np.array([tree[n].j for n in along[behind].tolist()])
    covariances = np.stack([tree[n].registration.covariance for n in along[behind].tolist()])
    spread[behind] = propagated(poses[sources], covariances)
    for k in order:
        if reached_from[k] != k:
            spread[k] += spread[reached_from[k]]
    return spread
