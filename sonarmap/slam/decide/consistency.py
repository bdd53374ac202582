"""Pairwise consistency of hypotheses over cycles, and groups of hypotheses without contradictions.

Mangelson, Dominic, Eustice and Vasudevan, "Pairwise consistent measurement set maximization for robust multi-robot
map merging" (ICRA 2018, DOI 10.1109/ICRA.2018.8460217). Two hypotheses between the same two components close
a cycle through the chains of both. With a wrong hypothesis the cycle rarely closes within its uncertainty, and wrong
ones rarely agree with each other. A hypothesis within a component closes a cycle with the component's chain.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.decide.possible_edge import PossibleEdge, Support
from sonarmap.slam.graph.edge import Edge, components
from sonarmap.slam.graph.tangent import lengths, propagated
from sonarmap.slam.graph.trajectory import composed

_MAX_SCANS_APART = 5  # between the ends of two loops that are compared, at each end
_BLOCK = 20_000  # cycles computed at a time
# Hypotheses that each is compared with, the nearest at both ends: over a long chain even wrong ones agree.
_COMPARED = 100
# A direction with a larger sigma is unconstrained [added sigmas]. A hypothesis that is farther than this from the chain
# was measured at another place: hulls and quays bend, and many such hypotheses would shorten the track.
_UNCONSTRAINED = 20.0
MIN_LEAD = 2.0  # least weight by which a leading group exceeds the next one [natural logarithm of probability]


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


@dataclass(frozen=True, slots=True)
class Comparison:
    """Possible edges compared with the chain of their component, and with each other."""

    parts: tuple[np.ndarray, ...]  # indices of the possible edges between each pair of components
    sigmas: np.ndarray  # (n,) distance of each from its component's chain; NaN if it joins two components
    # agree, contradict: (n, n) sparse, symmetric, 1 where two agree or contradict each other; those of one pair do
    agree: sparse.csr_array
    contradict: sparse.csr_array
    bound: float  # largest distance of two that agree [sigmas]
    elsewhere: np.ndarray  # (n,) bool, whether a direction is unconstrained and the component's chain far away

    def support(self, possible_edges: Sequence[PossibleEdge]) -> list[PossibleEdge]:
        """The compared possible edges, in their order, with their support by their current weights."""
        weight = np.array([possible.weight for possible in possible_edges])
        support: dict[int, Support] = {}
        for members in self.parts:
            heaviest = [(independent_weight([possible_edges[k] for k in g]), g) for g in self._groups(members, weight)]
            heaviest.sort(key=lambda each: (-each[0], each[1][0]))
            clear = len(heaviest) == 1 or heaviest[0][0] >= heaviest[1][0] + MIN_LEAD
            for rank, (independent, group) in enumerate(heaviest):
                counted = [possible_edges[k] for k in group if possible_edges[k].counts]
                pairs = len({possible.scans for possible in counted})
                for k in group:
                    sigmas, leads = float(self.sigmas[k]), rank == 0 and clear
                    support[k] = Support(
                        pairs, independent, leads, sigmas, sigmas <= self.bound, bool(self.elsewhere[k])
                    )
        return [replace(possible, support=support[k]) for k, possible in enumerate(possible_edges)]

    def contradicting(self, possible_edges: Sequence[PossibleEdge]) -> list[list[int]]:
        """Indices of the groups within a component that contradict its chain."""
        weight = np.array([possible.weight for possible in possible_edges])
        groups: list[list[int]] = []
        for members in self.parts:
            outside = members[(self.sigmas[members] > self.bound) & ~self.elsewhere[members]]
            groups += self._groups(outside, weight) if len(outside) else []
        return groups

    def _groups(self, members: np.ndarray, weight: np.ndarray) -> list[list[int]]:
        """Groups without contradictions, the heaviest first, built greedily from the members with the most support.

        Members that agree with the chain form one group; in the others, agreement connects the members."""
        of_chain = self.sigmas[members] <= self.bound
        groups = self._grown(members[of_chain], weight)[:1]
        remaining = np.setdiff1d(members, [k for group in groups for k in group])
        # pyrefly: ignore[bad-index]
        _, place = connected_components(self.agree[remaining][:, remaining], directed=False)
        for connected in np.split(remaining[np.argsort(place, kind="stable")], np.cumsum(np.bincount(place))[:-1]):
            groups += self._grown(connected, weight, apart=True)
        return groups

    def _grown(self, among: np.ndarray, weight: np.ndarray, apart: bool = False) -> list[list[int]]:
        """Groups of these, one after the other; `apart` splits groups whose members no agreement connects."""
        groups: list[list[int]] = []
        while len(among):
            group = self._grow(among, weight)
            among = np.setdiff1d(among, group)
            if apart and len(group) > 1:
                # pyrefly: ignore[bad-index]
                count, place = connected_components(self.agree[group][:, group], directed=False)
                groups += [np.array(group)[place == number].tolist() for number in range(count)]
            else:
                groups.append(group)
        return groups

    def _grow(self, among: np.ndarray, weight: np.ndarray) -> list[int]:
        """One group of these: in the order of their support, each that contradicts none in the group."""
        if len(among) == 1:
            return among.tolist()
        # pyrefly: ignore[bad-index]
        support = weight[among] + self.agree[among][:, among] @ weight[among]
        inside = np.zeros(len(weight), bool)
        first, others = self.contradict.indptr, self.contradict.indices
        for k in among[np.lexsort((among, -support))].tolist():
            inside[k] = not inside[others[first[k] : first[k + 1]]].any()
        return np.flatnonzero(inside).tolist()


def independent_weight(group: Sequence[PossibleEdge]) -> float:
    """Negative logarithm of the probability that all hypotheses of a group are wrong. Of those that were sought where
    they are expected only the best counts, as one wrong expectation misleads all of them."""
    sought = max((each.weight for each in group if each.expected), default=0.0)
    return sought + sum(each.weight for each in group if not each.expected)


def compare(chains: Chains, possible_edges: Sequence[PossibleEdge], floor: np.ndarray, bound: float) -> Comparison:
    """Compare possible edges over the cycles that they close.

    Args:
        chains: of the survey's scans.
        possible_edges: of any pairs; those of one pair exclude each other.
        floor: (6,) standard deviations added in quadrature to those of every possible edge [rad, m].
        bound: largest distance of two that agree [sigmas].
    """
    count = len(possible_edges)
    if not count:
        nothing = sparse.csr_array((0, 0))
        return Comparison((), np.zeros(0), nothing, nothing, bound, np.zeros(0, bool))
    cycles = _Cycles.of(chains, possible_edges, floor**2)
    parts = np.sort(np.column_stack([chains.part[cycles.i], chains.part[cycles.j]]), axis=1)
    _, number = np.unique(parts, axis=0, return_inverse=True)
    members = tuple(np.split(np.argsort(number, kind="stable"), np.cumsum(np.bincount(number))[:-1]))
    inside = np.flatnonzero(parts[:, 0] == parts[:, 1])
    sigmas = np.full(count, np.nan)
    sigmas[inside] = cycles.from_chain(inside)
    pairs = np.concatenate([_neighbors(cycles.i, cycles.j, chosen) for chosen in members])
    within = cycles.agree(pairs[:, 0], pairs[:, 1], bound)
    same_pair = (cycles.i[pairs[:, 0]] == cycles.i[pairs[:, 1]]) & (cycles.j[pairs[:, 0]] == cycles.j[pairs[:, 1]])
    agree, contradict = (_symmetric(pairs[chosen], count) for chosen in (within & ~same_pair, ~within | same_pair))
    elsewhere, far = np.zeros(count, bool), _UNCONSTRAINED * float(floor[3:].max())
    if far > 0:
        elsewhere[inside] = _elsewhere([possible_edges[k] for k in inside.tolist()], chains, far)
    return Comparison(members, sigmas, agree, contradict, bound, elsewhere)


def _elsewhere(edges: Sequence[PossibleEdge], chains: Chains, far: float) -> np.ndarray:
    """(m,) bool: whether hypotheses within a component leave a direction unconstrained, `far` [m] from its chain."""
    if not edges:
        return np.zeros(0, bool)
    i, j = np.array([edge.scans for edge in edges]).T
    measured = RigidTransform.concatenate([edge.registration.T_target_source for edge in edges])
    away = (measured.inv() * chains.T[i].inv() * chains.T[j]).translation
    shift = np.stack([edge.registration.covariance[3:, 3:] for edge in edges])
    return (np.linalg.eigvalsh(shift)[:, -1] > far**2) & (np.linalg.norm(away, axis=1) > far)


def agreeing_groups(chains: Chains, loops: Sequence[Edge], bound: float) -> np.ndarray:
    """(m,) int, the group of each loop; a loop that agrees with no other is alone.

    Only loops with neighboring ends are compared, as the chain between these is short and certain.

    Args:
        chains: of the poses, along a spanning tree of a graph.
        loops: m other edges of it.
        bound: largest error of a cycle [sigmas].
    """
    if not loops:
        return np.zeros(0, np.intp)
    cycles = _Cycles.of(chains, loops)
    near = KDTree(np.column_stack([cycles.i, cycles.j])).query_pairs(_MAX_SCANS_APART, p=np.inf, output_type="ndarray")
    near = near[np.equal(*chains.part[cycles.i[near]].T)]
    links = _symmetric(near[cycles.agree(near[:, 0], near[:, 1], bound)], len(loops))
    return connected_components(links, directed=False)[1]


def distances_from_chain(chains: Chains, loops: Sequence[Edge]) -> np.ndarray:
    """(m,) distance of each of m loops from the chains of their poses, along a spanning tree of a graph [sigmas]."""
    if not loops:
        return np.zeros(0)
    return _Cycles.of(chains, loops).from_chain(np.arange(len(loops)))


def _neighbors(i: np.ndarray, j: np.ndarray, members: np.ndarray) -> np.ndarray:
    """(m, 2) pairs of these members, each once: every member with the nearest in scans at both ends."""
    if len(members) <= _COMPARED + 1:
        return members[np.column_stack(np.triu_indices(len(members), 1))]
    ends = np.column_stack([i[members], j[members]]).astype(np.float64)
    _, near = KDTree(ends).query(ends, _COMPARED + 1, p=np.inf)
    both = np.sort(np.column_stack([np.repeat(np.arange(len(members)), _COMPARED + 1), near.ravel()]), axis=1)
    both = np.unique(both[both[:, 0] != both[:, 1]], axis=0)
    return members[both]


def _symmetric(pairs: np.ndarray, count: int) -> sparse.csr_array:
    """(count, count) with 1 at (m, 2) pairs of indices, and transposed."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    ends = both[:, 0], both[:, 1]
    return sparse.csr_array((np.ones(len(both)), ends), shape=(count, count))


@dataclass(frozen=True, slots=True)
class _Cycles:
    """n hypotheses in the frames of their components."""

    # i, j: (n,) int, the scans; i is in the component with the lower number, or the lower scan of one component
    i: np.ndarray
    j: np.ndarray
    X: RigidTransform  # n transforms T_parti_partj between their frames
    noise: np.ndarray  # (n, 6, 6) covariance of X by the registration alone, on the left
    chains: Chains  # of the survey's scans

    @classmethod
    def of(
        cls, chains: Chains, edges: Sequence[PossibleEdge] | Sequence[Edge], added: np.ndarray | float = 0.0
    ) -> "_Cycles":
        """With (6,) variances added to those of the registrations."""
        i, j = np.array([(edge.i, edge.j) for edge in edges]).T
        measured = RigidTransform.concatenate([edge.registration.T_target_source for edge in edges])
        covariance = np.stack([edge.registration.covariance for edge in edges]) + np.diag(np.zeros(6) + added)
        placed = chains.T[i] * measured
        X, noise = placed * chains.T[j].inv(), propagated(placed, covariance)
        # scans of interleaved components can be measured in either direction
        part = chains.part[i], chains.part[j]
        back = (part[0] > part[1]) | ((part[0] == part[1]) & (i > j))
        X = RigidTransform.concatenate([T.inv() if turned else T for T, turned in zip(X, back, strict=True)])
        noise[back] = propagated(X[back], noise[back])
        return cls(np.where(back, j, i), np.where(back, i, j), X, noise, chains)

    def from_chain(self, members: np.ndarray) -> np.ndarray:
        """(m,) distance of hypotheses within a component from its chain [sigmas]."""
        covariance = self.noise[members] + self.chains.between(self.i[members], self.j[members])
        return lengths(self.X[members].as_exp_coords(), covariance)

    def agree(self, a: np.ndarray, b: np.ndarray, bound: float) -> np.ndarray:
        """(m,) bool: whether hypotheses a and b between the same components agree within the bound."""
        result = np.empty(len(a), dtype=bool)
        for start in range(0, len(a), _BLOCK):
            block = slice(start, start + _BLOCK)
            result[block] = self._distance(a[block], b[block]) <= bound
        return result

    def _distance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(m,) errors of the cycles through hypotheses a and b [sigmas]."""
        X, between = self.X[a], self.chains.between
        covariance = self.noise[a] + self.noise[b]
        covariance += between(self.i[a], self.i[b]) + propagated(X, between(self.j[a], self.j[b]))
        return lengths((X * self.X[b].inv()).as_exp_coords(), covariance)
