"""Which answers agree with one another: pairwise consistency over cycles, and the groups in which all agree.

Mangelson, Dominic, Eustice and Vasudevan, "Pairwise consistent measurement set maximization for robust multi-robot
map merging" (ICRA 2018, DOI 10.1109/ICRA.2018.8460217). Two answers between the same two runs of scans close a cycle
through both runs; a right one and a wrong one do not meet again within what the cycle's uncertainty allows, and wrong
ones seldom meet each other. An answer within one run closes a cycle with the run itself.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from slam.decide.possible_edge import PossibleEdge, Support
from slam.graph.edge import Edge, components, spanning_tree
from slam.graph.tangent import carried
from spectral.result import Registration

_BLOCK = 20_000  # cycles that are looked at together
# A group leads where the probability that all of it is wrong is below the next one's by this power of e.
_CLEARLY = 2.0


@dataclass(frozen=True, slots=True)
class Chains:
    """Scans chained into parts by edges that are trusted, without a cycle.

    Attributes:
        part: (N,) int, the number of each scan's part, 0, 1, ... in the order of their first scans.
        T: N poses, each in the frame of its part's first scan [m].
        spread: (N, 6, 6) covariance that gathers from the part's first scan to each, of a tangent in the part's frame
            (on the left), rotation first [rad, m].
        meeting: (N, N) int32, the scan at which the ways from the first scan to two of its part divide.
    """

    part: np.ndarray
    T: RigidTransform
    spread: np.ndarray
    meeting: np.ndarray

    def between(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """(m, 6, 6) what gathers on the way from scans i to scans j of their part."""
        return self.spread[i] + self.spread[j] - 2 * self.spread[self.meeting[i, j]]


def chain_parts(count: int, edges: Sequence[Edge]) -> Chains:
    """The parts of `count` scans that edges join, each chained along a spanning tree from its first scan on."""
    neighbors: dict[int, list[tuple[int, Registration, bool]]] = defaultdict(list)
    for edge in spanning_tree(count, edges):
        neighbors[edge.i].append((edge.j, edge.registration, True))
        neighbors[edge.j].append((edge.i, edge.registration, False))
    part, spread = np.empty(count, np.intp), np.zeros((count, 6, 6))
    poses = [RigidTransform.identity()] * count
    meeting = np.zeros((count, count), np.int32)
    for number, members in enumerate(components(count, edges)):
        reached, known = [members[0]], {members[0]}
        meeting[members[0], members[0]] = members[0]
        part[list(members)] = number
        for i in reached:
            for j, registration, forward in neighbors[i]:
                if j in known:
                    continue
                T = registration.T_target_source
                poses[j] = poses[i] * (T if forward else T.inv())
                # the noise is on the side of the measured pair's source
                spread[j] = spread[i] + carried(poses[j] if forward else poses[i], registration.covariance)
                meeting[j, reached] = meeting[reached, j] = meeting[i, reached]
                meeting[j, j] = j
                reached.append(j)
                known.add(j)
    return Chains(part, RigidTransform.concatenate(poses), spread, meeting)


def find_support(
    chains: Chains, possible_edges: Sequence[PossibleEdge], floor: np.ndarray, bound: float
) -> list[PossibleEdge]:
    """The possible edges with their support, in their order.

    Args:
        chains: of the survey's scans.
        possible_edges: answers of any pairs; those of one pair exclude each other.
        floor: (6,) standard deviations [rad, m] that are granted to every answer beside its own covariance.
        bound: largest distance of two that agree [sigmas].
    """
    if not possible_edges:
        return []
    cycles = _Cycles.of(chains, possible_edges, floor)
    weight = np.array([possible.weight for possible in possible_edges])
    parts = np.sort(np.column_stack([chains.part[cycles.i], chains.part[cycles.j]]), axis=1)
    _, part_pair = np.unique(parts, axis=0, return_inverse=True)
    support: dict[int, Support] = {}
    for number in range(part_pair.max() + 1):
        members = np.flatnonzero(part_pair == number)
        inside = parts[members[0], 0] == parts[members[0], 1]
        sigmas = cycles.from_chain(members) if inside else np.full(len(members), np.nan)
        groups = _groups(cycles.agree(members, bound), weight[members], sigmas <= bound)
        heaviest = [weight[members[group]].sum() for group in groups]
        clear = len(groups) == 1 or heaviest[0] >= heaviest[1] + _CLEARLY
        for rank, group in enumerate(groups):
            counted = [possible_edges[k] for k in members[group].tolist() if possible_edges[k].counts]
            pairs = len({possible.scans for possible in counted})
            for k in group:
                agrees = bool(sigmas[k] <= bound)
                leads = rank == 0 and clear
                support[int(members[k])] = Support(pairs, float(heaviest[rank]), leads, float(sigmas[k]), agrees)
    return [replace(possible, support=support[k]) for k, possible in enumerate(possible_edges)]


@dataclass(frozen=True, slots=True)
class _Cycles:
    """n possible edges in the frames of their parts.

    Attributes:
        i, j: (n,) int, the scans, i in the part of the lower number.
        X: n transforms T_parti_partj between their frames.
        noise: (n, 6, 6) covariance of X by the registration alone, on the left.
        chains: of the survey's scans.
    """

    i: np.ndarray
    j: np.ndarray
    X: RigidTransform
    noise: np.ndarray
    chains: Chains

    @classmethod
    def of(cls, chains: Chains, possible_edges: Sequence[PossibleEdge], floor: np.ndarray) -> "_Cycles":
        i, j = np.array([possible.scans for possible in possible_edges]).T
        registrations = [possible.registration for possible in possible_edges]
        measured = RigidTransform.concatenate([registration.T_target_source for registration in registrations])
        covariance = np.stack([registration.covariance for registration in registrations]) + np.diag(floor**2)
        placed = chains.T[i] * measured
        X, noise = placed * chains.T[j].inv(), carried(placed, covariance)
        # scans are counted in their order, and parts that interleave may be measured from either
        back = chains.part[i] > chains.part[j]
        X = RigidTransform.concatenate([T.inv() if turned else T for T, turned in zip(X, back, strict=True)])
        noise[back] = carried(X[back], noise[back])
        return cls(np.where(back, j, i), np.where(back, i, j), X, noise, chains)

    def from_chain(self, members: np.ndarray) -> np.ndarray:
        """(m,) how far possible edges within a part are from its own chain [sigmas]."""
        covariance = self.noise[members] + self.chains.between(self.i[members], self.j[members])
        return _mahalanobis(self.X[members].as_exp_coords(), covariance)

    def agree(self, members: np.ndarray, bound: float) -> np.ndarray:
        """(m, m) bool: which two possible edges between the same parts are of different pairs and within the bound."""
        a, b = np.triu_indices(len(members), 1)
        result = np.zeros((len(members), len(members)), dtype=bool)
        for start in range(0, len(a), _BLOCK):
            first, second = a[start : start + _BLOCK], b[start : start + _BLOCK]
            result[first, second] = self._distance(members[first], members[second]) <= bound
        return result | result.T

    def _distance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(m,) of the cycles through possible edges a and b [sigmas]; infinite for two of one pair."""
        X, between = self.X[a], self.chains.between
        covariance = self.noise[a] + self.noise[b]
        covariance += between(self.i[a], self.i[b]) + carried(X, between(self.j[a], self.j[b]))
        sigmas = _mahalanobis((X * self.X[b].inv()).as_exp_coords(), covariance)
        return np.where((self.i[a] == self.i[b]) & (self.j[a] == self.j[b]), np.inf, sigmas)


def _mahalanobis(xi: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(m,) lengths of tangents (m, 6) under their covariances."""
    return np.sqrt(np.einsum("na,na->n", xi, np.linalg.solve(covariance, xi[..., None])[..., 0]))


def _groups(agree: np.ndarray, weight: np.ndarray, of_chain: np.ndarray) -> list[list[int]]:
    """Groups of which all members agree, the heaviest first; built greedily, from those with the most support.

    Args:
        agree: (n, n) bool, symmetric.
        weight: (n,) of the possible edges.
        of_chain: (n,) bool, which agree with the chain they are in: these make the first group.
    """
    left = np.arange(len(weight))
    groups = [_grow(agree, weight, left[of_chain])] if of_chain.any() else []
    left = np.setdiff1d(left, groups)
    while len(left):
        groups.append(_grow(agree, weight, left))
        left = np.setdiff1d(left, groups[-1])
    return sorted(groups, key=lambda group: (-weight[group].sum(), group[0]))


def _grow(agree: np.ndarray, weight: np.ndarray, among: np.ndarray) -> list[int]:
    """One group of these: from the one with the most support on, every next that agrees with all so far."""
    support = weight[among] + agree[np.ix_(among, among)] @ weight[among]
    group: list[int] = []
    for k in among[np.lexsort((among, -support))].tolist():
        if agree[k, group].all():
            group.append(k)
    return sorted(group)
