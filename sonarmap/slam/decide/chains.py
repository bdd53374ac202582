"""Scans chained into components by trusted edges: their poses, and the covariance that accumulates along the chains."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import Edge, components
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.graph.trajectory import composed


@dataclass(frozen=True, slots=True)
class Chains:
    """Spanning trees of the components of N scans.

    `rank` is their preorder: all scans that are reached through a scan follow it without a break.
    """

    part: np.ndarray  # (N,) int, the number of each scan's component, 0, 1, ... in the order of their first scans
    T: RigidTransform  # N poses, each in the frame of its component's first scan [m]
    # (N, 6, 6) accumulated from the component's first scan to each, of a tangent in the component's frame (on the
    # left), rotation first [rad, m]
    covariance: np.ndarray
    rank: np.ndarray  # (N,) int, the rank of each scan
    scan: np.ndarray  # (N,) int, the scan of each rank
    # (levels, N) int: at [l, k] the lowest rank among the parents of the 2^l scans from rank k on
    before: np.ndarray

    def between(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """(m, 6, 6) covariance accumulated between scans i and j of one component."""
        return self.covariance[i] + self.covariance[j] - 2 * self.covariance[self.meeting(i, j)]

    def meeting(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """(m,) the lowest common ancestor of scans i and j of one component.

        Its rank is the lowest among the parents of the scans that are ranked between them.
        """
        low, high = np.minimum(self.rank[i], self.rank[j]), np.maximum(self.rank[i], self.rank[j])
        level = np.frexp(np.maximum(high - low, 1))[1] - 1
        lowest = np.minimum(self.before[level, np.minimum(low + 1, high)], self.before[level, high - 2**level + 1])
        return self.scan[np.where(low == high, low, lowest)]


def chain_parts(count: int, edges: Sequence[Edge]) -> Chains:
    """The components of `count` scans, each chained from its first scan along a spanning tree of the edges."""
    outward = composed(count, edges, {})
    poses, before, scan = RigidTransform.from_matrix(outward.T), outward.before, outward.order
    part, accumulated, rank = np.empty(count, np.intp), np.zeros((count, 6, 6)), np.empty(count, np.intp)
    for number, members in enumerate(components(count, edges)):
        part[list(members)] = number
    reached = np.flatnonzero(before != np.arange(count))
    if len(reached):
        tree_edges = [outward.tree[n] for n in outward.by[reached].tolist()]
        # the covariance of an edge is of the tangent of its source
        noise = np.stack([edge.registration.covariance for edge in tree_edges])
        accumulated[reached] = propagated(poses[np.array([edge.j for edge in tree_edges])], noise)
    for k in scan.tolist():
        if before[k] != k:
            accumulated[k] += accumulated[before[k]]
    rank[scan] = np.arange(count)
    return Chains(part, poses, accumulated, rank, scan, _lowest_before(rank[before[scan]]))


def _lowest_before(before: np.ndarray) -> np.ndarray:
    """`Chains.before`, (levels, N), from the rank (N,) of the parent of the scan of each rank."""
    levels = [before]
    while 2 ** len(levels) <= len(before):
        half, last = 2 ** (len(levels) - 1), levels[-1]
        levels.append(np.minimum(last, np.concatenate([last[half:], last[-1:].repeat(half)])))
    return np.stack(levels)
