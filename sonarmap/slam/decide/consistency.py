"""Which answers agree with one another: pairwise consistency over cycles, and the groups in which all agree.

Mangelson, Dominic, Eustice and Vasudevan, "Pairwise consistent measurement set maximization for robust multi-robot
map merging" (ICRA 2018, DOI 10.1109/ICRA.2018.8460217). Two answers between the same two runs of scans close a cycle
through both runs; a right one and a wrong one do not meet again within what the cycle's uncertainty allows, and wrong
ones seldom meet each other. An answer within one run closes a cycle with the run itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.decide.chains import Chains
from sonarmap.slam.decide.possible_edge import PossibleEdge, Support
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.tangent import lengths, propagated

_NEAR = 5  # poses along the chain within which two loops are compared at either end
_BLOCK = 20_000  # cycles that are looked at together
# Each answer is compared with so many others, those nearest at both ends: a long way between two leaves so much open
# that they agree whatever they say.
_COMPARED = 100
# A direction is open where it is less certain than so many granted standard deviations. What scans show so far off
# along it is not what they show where they are: hulls and quays bend, and a few centimeters across, said of another
# place by many such answers, shorten the way.
_FAR = 20.0
# A group leads where the probability that all of it is wrong is below the next one's by this power of e.
_CLEARLY = 2.0


@dataclass(frozen=True, slots=True)
class Comparison:
    """Answers compared with the chain that they lie in, and with each other."""

    parts: tuple[np.ndarray, ...]  # n indices of answers of each pair of parts
    sigmas: np.ndarray  # (n,) distance of each from its part's own chain; NaN where it joins two parts
    # agree, contradict: (n, n) sparse, symmetric, 1 where two of different pairs were compared and agree, or do not
    agree: sparse.csr_array
    contradict: sparse.csr_array
    bound: float  # largest distance of two that agree [sigmas]
    elsewhere: np.ndarray  # (n,) bool, whether one that leaves a direction open is of a place far from its part's chain

    def support(self, possible_edges: Sequence[PossibleEdge]) -> list[PossibleEdge]:
        """The same answers as were compared, in their order, with their support; by what they weigh now."""
        weight = np.array([possible.weight for possible in possible_edges])
        support: dict[int, Support] = {}
        for members in self.parts:
            groups = self._groups(members, weight)
            heaviest = [float(weight[group].sum()) for group in groups]
            clear = len(groups) == 1 or heaviest[0] >= heaviest[1] + _CLEARLY
            for rank, group in enumerate(groups):
                counted = [possible_edges[k] for k in group if possible_edges[k].counts]
                pairs = len({possible.scans for possible in counted})
                for k in group:
                    sigmas, leads = float(self.sigmas[k]), rank == 0 and clear
                    support[k] = Support(
                        pairs, heaviest[rank], leads, sigmas, sigmas <= self.bound, bool(self.elsewhere[k])
                    )
        return [replace(possible, support=support[k]) for k, possible in enumerate(possible_edges)]

    def _groups(self, members: np.ndarray, weight: np.ndarray) -> list[list[int]]:
        """Groups of which no members contradict each other, the heaviest first; built greedily, from those with the
        most support. Those that agree with the chain they are in make the first, the others agree step by step."""
        of_chain = self.sigmas[members] <= self.bound
        groups = self._grown(members[of_chain], weight)[:1]
        left = np.setdiff1d(members, [k for group in groups for k in group])
        # pyrefly: ignore[bad-index]
        _, place = connected_components(self.agree[left][:, left], directed=False)
        for connected in np.split(left[np.argsort(place, kind="stable")], np.cumsum(np.bincount(place))[:-1]):
            groups += self._grown(connected, weight, apart=True)
        return sorted(groups, key=lambda group: (-weight[group].sum(), group[0]))

    def _grown(self, among: np.ndarray, weight: np.ndarray, apart: bool = False) -> list[list[int]]:
        """All groups of these, one after the other; `apart`: members that no agreement joins are of several."""
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
        """One group of these: from the one with the most support on, every next that contradicts none so far."""
        if len(among) == 1:
            return among.tolist()
        # pyrefly: ignore[bad-index]
        support = weight[among] + self.agree[among][:, among] @ weight[among]
        inside = np.zeros(len(weight), bool)
        first, others = self.contradict.indptr, self.contradict.indices
        for k in among[np.lexsort((among, -support))].tolist():
            inside[k] = not inside[others[first[k] : first[k + 1]]].any()
        return np.flatnonzero(inside).tolist()


def compare(chains: Chains, possible_edges: Sequence[PossibleEdge], floor: np.ndarray, bound: float) -> Comparison:
    """Answers compared over the cycles that they close.

    Args:
        chains: of the survey's scans.
        possible_edges: answers of any pairs; those of one pair exclude each other.
        floor: (6,) standard deviations [rad, m] that are granted to every answer beside its own covariance.
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
    of_one = (cycles.i[pairs[:, 0]] == cycles.i[pairs[:, 1]]) & (cycles.j[pairs[:, 0]] == cycles.j[pairs[:, 1]])
    agree, contradict = (_symmetric(pairs[chosen], count) for chosen in (within & ~of_one, ~within | of_one))
    elsewhere, far = np.zeros(count, bool), _FAR * float(floor[3:].max())
    if far > 0:
        elsewhere[inside] = _elsewhere([possible_edges[k] for k in inside.tolist()], chains, far)
    return Comparison(members, sigmas, agree, contradict, bound, elsewhere)


def _elsewhere(answers: Sequence[PossibleEdge], chains: Chains, far: float) -> np.ndarray:
    """(m,) bool of answers within a part: whether they leave a direction open, and lie `far` [m] from its chain."""
    if not answers:
        return np.zeros(0, bool)
    i, j = np.array([answer.scans for answer in answers]).T
    measured = RigidTransform.concatenate([answer.registration.T_target_source for answer in answers])
    away = (measured.inv() * chains.T[i].inv() * chains.T[j]).translation
    shift = np.stack([answer.registration.covariance[3:, 3:] for answer in answers])
    return (np.linalg.eigvalsh(shift)[:, -1] > far**2) & (np.linalg.norm(away, axis=1) > far)


def agreeing_groups(chains: Chains, loops: Sequence[Edge], bound: float) -> np.ndarray:
    """The number of each loop's group: (m,) int; a loop that agrees with no other is alone.

    Loops between neighbors of the same two places agree where the chain between them, which is short and therefore
    sure, shows it.

    Args:
        chains: of the poses, along a spanning tree of a graph.
        loops: m other edges of it.
        bound: largest error of a cycle [sigmas].
    """
    if not loops:
        return np.zeros(0, np.intp)
    cycles = _Cycles.of(chains, loops)
    near = KDTree(np.column_stack([cycles.i, cycles.j])).query_pairs(_NEAR, p=np.inf, output_type="ndarray")
    near = near[np.equal(*chains.part[cycles.i[near]].T)]
    links = _symmetric(near[cycles.agree(near[:, 0], near[:, 1], bound)], len(loops))
    return connected_components(links, directed=False)[1]


def distances_from_chain(chains: Chains, loops: Sequence[Edge]) -> np.ndarray:
    """(m,) how far each loop is from what the chain alone says [sigmas]; both as of `agreeing_groups`."""
    if not loops:
        return np.zeros(0)
    return _Cycles.of(chains, loops).from_chain(np.arange(len(loops)))


def _neighbors(i: np.ndarray, j: np.ndarray, members: np.ndarray) -> np.ndarray:
    """(m, 2) of these answers, each once with those nearest to it at both ends, counted in scans."""
    if len(members) <= _COMPARED + 1:
        return members[np.column_stack(np.triu_indices(len(members), 1))]
    ends = np.column_stack([i[members], j[members]]).astype(np.float64)
    _, near = KDTree(ends).query(ends, _COMPARED + 1, p=np.inf)
    both = np.sort(np.column_stack([np.repeat(np.arange(len(members)), _COMPARED + 1), near.ravel()]), axis=1)
    both = np.unique(both[both[:, 0] != both[:, 1]], axis=0)
    return members[both]


def _symmetric(pairs: np.ndarray, count: int) -> sparse.csr_array:
    """(count, count) with 1 at these (m, 2) places, each way."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    ends = both[:, 0], both[:, 1]
    return sparse.csr_array((np.ones(len(both)), ends), shape=(count, count))


@dataclass(frozen=True, slots=True)
class _Cycles:
    """n answers in the frames of their parts."""

    # i, j: (n,) int, the scans, i in the part of the lower number, or the lower of one part
    i: np.ndarray
    j: np.ndarray
    X: RigidTransform  # n transforms T_parti_partj between their frames
    noise: np.ndarray  # (n, 6, 6) covariance of X by the registration alone, on the left
    chains: Chains  # of the survey's scans

    @classmethod
    def of(
        cls, chains: Chains, answers: Sequence[PossibleEdge] | Sequence[Edge], granted: np.ndarray | float = 0.0
    ) -> "_Cycles":
        """With (6,) variances that are granted beside the registrations'."""
        i, j = np.array([(answer.i, answer.j) for answer in answers]).T
        measured = RigidTransform.concatenate([answer.registration.T_target_source for answer in answers])
        covariance = np.stack([answer.registration.covariance for answer in answers]) + np.diag(np.zeros(6) + granted)
        placed = chains.T[i] * measured
        X, noise = placed * chains.T[j].inv(), propagated(placed, covariance)
        # scans are counted in their order, and parts that interleave may be measured from either
        part = chains.part[i], chains.part[j]
        back = (part[0] > part[1]) | ((part[0] == part[1]) & (i > j))
        X = RigidTransform.concatenate([T.inv() if turned else T for T, turned in zip(X, back, strict=True)])
        noise[back] = propagated(X[back], noise[back])
        return cls(np.where(back, j, i), np.where(back, i, j), X, noise, chains)

    def from_chain(self, members: np.ndarray) -> np.ndarray:
        """(m,) how far possible edges within a part are from its own chain [sigmas]."""
        covariance = self.noise[members] + self.chains.between(self.i[members], self.j[members])
        return lengths(self.X[members].as_exp_coords(), covariance)

    def agree(self, a: np.ndarray, b: np.ndarray, bound: float) -> np.ndarray:
        """(m,) bool: whether possible edges a and b between the same parts are within the bound."""
        result = np.empty(len(a), dtype=bool)
        for start in range(0, len(a), _BLOCK):
            block = slice(start, start + _BLOCK)
            result[block] = self._distance(a[block], b[block]) <= bound
        return result

    def _distance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(m,) of the cycles through possible edges a and b [sigmas]."""
        X, between = self.X[a], self.chains.between
        covariance = self.noise[a] + self.noise[b]
        covariance += between(self.i[a], self.i[b]) + propagated(X, between(self.j[a], self.j[b]))
        return lengths((X * self.X[b].inv()).as_exp_coords(), covariance)
