"""Scans chained into parts by edges that are trusted: where each is in its part, and what error gathers on the way."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import Edge, components
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.graph.trajectory import composed


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
    outward = composed(count, edges, {})
    poses, before, scan = RigidTransform.from_matrix(outward.T), outward.before, outward.order
    part, gathered, rank = np.empty(count, np.intp), np.zeros((count, 6, 6)), np.empty(count, np.intp)
    for number, members in enumerate(components(count, edges)):
        part[list(members)] = number
    behind = np.flatnonzero(before != np.arange(count))
    if len(behind):
        by = [outward.tree[n] for n in outward.by[behind].tolist()]
        # the noise is on the side of the measured pair's source
        noise = np.stack([edge.registration.covariance for edge in by])
        gathered[behind] = propagated(poses[np.array([edge.j for edge in by])], noise)
    for k in scan.tolist():
        if before[k] != k:
            gathered[k] += gathered[before[k]]
    rank[scan] = np.arange(count)
    return Chains(part, poses, gathered, rank, scan, _lowest_before(rank[before[scan]]))


def _lowest_before(before: np.ndarray) -> np.ndarray:
    """(levels, N) as of `Chains`, by the place (N,) that the scan at each place is reached from."""
    levels = [before]
    while 2 ** len(levels) <= len(before):
        half, last = 2 ** (len(levels) - 1), levels[-1]
        levels.append(np.minimum(last, np.concatenate([last[half:], last[-1:].repeat(half)])))
    return np.stack(levels)
