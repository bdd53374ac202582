"""Scans chained into parts by edges that are trusted: where each is in its part, what error gathers on the way, and
which loops agree.

Loops between neighbors of the same two places agree where the chain between them, which is short and therefore sure,
shows it (pairwise consistency: Mangelson, Dominic, Eustice and Vasudevan, ICRA 2018, DOI 10.1109/ICRA.2018.8460217).
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import Edge, components, spanning_tree
from sonarmap.slam.graph.tangent import lengths, propagated

NEAR = 5  # poses along the chain within which two loops are compared at either end


@dataclass(frozen=True, slots=True)
class Chains:
    """Scans chained into parts, without a cycle.

    They are numbered so that every scan comes before those behind it, and all behind it follow in a row.
    """

    part: np.ndarray  # (N,) int, the number of each scan's part, 0, 1, ... in the order of their first scans.
    T: RigidTransform  # N poses, each in the frame of its part's first scan [m]
    # (N, 6, 6) that gathers from the part's first scan to each, of a tangent in the part's frame (on the left),
    # rotation first [rad, m]
    covariance: np.ndarray
    rank: np.ndarray  # (N,) int, the place of each scan in the order, and `scan`: (N,) int, the scan at each place
    scan: np.ndarray
    # (levels, N) int: at [l, k] the lowest place that any of the 2^l scans from place k on is reached from
    before: np.ndarray

    def between(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """(m, 6, 6) what gathers from scans i to scans j of their part."""
        return self.covariance[i] + self.covariance[j] - 2 * self.covariance[self.meeting(i, j)]

    def meeting(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """(m,) the last scan by which both i and j are reached from the first of their part.

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
    poses, scan = RigidTransform.from_matrix(T), np.array(order, np.intp)
    gathered = np.zeros((count, 6, 6))
    behind = np.flatnonzero(reached_from != np.arange(count))
    if len(behind):
        by = [tree[n] for n in along[behind].tolist()]
        # the noise is on the side of the measured pair's source
        noise = np.stack([edge.registration.covariance for edge in by])
        gathered[behind] = propagated(poses[np.array([edge.j for edge in by])], noise)
    for k in order:
        if reached_from[k] != k:
            gathered[k] += gathered[reached_from[k]]
    rank = np.empty(count, np.intp)
    rank[scan] = np.arange(count)
    return Chains(part, poses, gathered, rank, scan, _lowest_before(rank[reached_from[scan]]))


def _lowest_before(before: np.ndarray) -> np.ndarray:
    """(levels, N) as of `Chains`, by the place (N,) that the scan at each place is reached from."""
    levels = [before]
    while 2 ** len(levels) <= len(before):
        half, last = 2 ** (len(levels) - 1), levels[-1]
        levels.append(np.minimum(last, np.concatenate([last[half:], last[-1:].repeat(half)])))
    return np.stack(levels)


def agreeing_groups(chains: Chains, loops: Sequence[Edge], bound: float) -> np.ndarray:
    """The number of each loop's group: (m,) int; a loop that agrees with no other is alone.

    Args:
        chains: of the poses, along edges that join neighbors.
        loops: m measurements.
        bound: largest error of a cycle [sigmas].
    """
    forward = [edge.i < edge.j for edge in loops]
    ends = np.array([(min(edge.i, edge.j), max(edge.i, edge.j)) for edge in loops]).reshape(-1, 2)
    near = KDTree(ends).query_pairs(NEAR, p=np.inf, output_type="ndarray")
    if not len(near):
        return np.arange(len(loops))
    measured = RigidTransform.concatenate([edge.registration.T_target_source for edge in loops])
    covariances = np.stack([edge.registration.covariance for edge in loops])
    backward = np.flatnonzero(~np.array(forward))
    if len(backward):
        covariances[backward] = propagated(measured[backward], covariances[backward])
        matrices = measured.as_matrix()
        matrices[backward] = measured[backward].inv().as_matrix()
        measured = RigidTransform.from_matrix(matrices)
    near = near[np.lexsort(near.T[::-1])]
    a, b = near.T
    T = chains.T
    T_ia_ib = T[ends[a, 0]].inv() * T[ends[b, 0]]
    T_jb_ja = T[ends[b, 1]].inv() * T[ends[a, 1]]
    cycle = T_ia_ib * measured[b] * T_jb_ja
    error = (measured[a].inv() * cycle).as_exp_coords()
    part = chains.part[ends]
    connected = (part[a] == part[b]).all(axis=1)
    total = covariances[a] + propagated(T_jb_ja.inv(), covariances[b])
    i_a, j_a, i_b, j_b = ends[a[connected], 0], ends[a[connected], 1], ends[b[connected], 0], ends[b[connected], 1]
    chain_i = propagated(T[i_b].inv(), chains.between(i_a, i_b))
    chain_j = propagated(T[j_a].inv(), chains.between(j_b, j_a))
    total[connected] += chain_j + propagated((measured[b] * T_jb_ja).inv()[connected], chain_i)
    in_agreement = connected & (lengths(error, total) <= bound)
    links = sparse.coo_array(
        (np.ones(int(in_agreement.sum())), (a[in_agreement], b[in_agreement])), shape=(len(loops), len(loops))
    )
    return connected_components(links, directed=False)[1]


def distances_from_chain(chains: Chains, loops: Sequence[Edge]) -> np.ndarray:
    """(m,) how far each loop is from what the chain alone says [sigmas]; 0 where the chain does not join its ends."""
    if not loops:
        return np.zeros(0)
    i, j = np.array([(edge.i, edge.j) for edge in loops]).T
    measured = RigidTransform.concatenate([edge.registration.T_target_source for edge in loops])
    error: np.ndarray = ((chains.T[i].inv() * chains.T[j]).inv() * measured).as_exp_coords()
    total = np.stack([edge.registration.covariance for edge in loops])
    joined = chains.part[i] == chains.part[j]
    total[joined] += propagated(chains.T[j[joined]].inv(), chains.between(i[joined], j[joined]))
    return np.where(joined, lengths(error, total), 0.0)
