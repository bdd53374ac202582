"""How sure poses are, and how their errors depend on each other: what is asked of the inverse of an information matrix.

An inverse is dense, but the entries where its factor is not zero follow from one another, from the last variable that
was eliminated to the first (Takahashi, Fagan and Chin 1973; Kaess and Dellaert, Robotics and Autonomous Systems 2009,
DOI 10.1016/j.robot.2009.06.008). That takes about as long as the elimination, and one pass tells all poses and as many
pairs of them as are asked for.
"""

from collections import Counter, defaultdict
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

_SIZE = 6  # numbers of a pose


@dataclass(frozen=True, slots=True)
class Marginals:
    """Covariances of N poses' body tangents, rotation first [rad, m]."""

    single: np.ndarray  # (N, 6, 6) of each pose
    # (m, 6, 6) of each pair (i, j) that was asked for: the expectation of the error of i times that of j
    across: np.ndarray


def marginals(linear: gtsam.GaussianFactorGraph, pairs: np.ndarray) -> Marginals:
    """Of the keys 0..N-1, and of pairs of them.

    Args:
        linear: factors at the optimum, of keys 0..N-1 with six numbers each.
        pairs: (m, 2) int, i and j differ.

    Raises:
        RuntimeError: the factors do not tell every pose.
    """
    asked = linear.clone()
    nothing, weight = np.zeros((1, _SIZE)), gtsam.noiseModel.Unit.Create(1)
    for i, j in np.unique(np.sort(np.concatenate([pairs.reshape(-1, 2), _ties(linear)]), axis=1), axis=0).tolist():
        # says nothing, but has the elimination keep how both depend on each other
        asked.add(gtsam.JacobianFactor(i, nothing, j, nothing, np.zeros(1), weight))
    # nested dissection, which takes half the time for pairs all over a plane; it ends the process on a single key
    ordering = (
        gtsam.Ordering.MetisGaussianFactorGraph
        if linear.keys().size() > 1
        else gtsam.Ordering.ColamdGaussianFactorGraph
    )
    return _Eliminated.of(_eliminated(asked, ordering(asked))).marginals(pairs.reshape(-1, 2))


def require_unique(linear: gtsam.GaussianFactorGraph) -> None:
    """Raise RuntimeError where the factors leave a pose undetermined."""
    ordering = gtsam.Ordering.ColamdGaussianFactorGraph(linear)
    try:
        linear.eliminateMultifrontal(ordering)
    except RuntimeError:
        linear.eliminateMultifrontal(ordering, gtsam.EliminateQR)


def _eliminated(linear: gtsam.GaussianFactorGraph, ordering: gtsam.Ordering) -> gtsam.GaussianBayesNet:
    """By Cholesky, or where that takes a pivot 4096 times below its neighbor for 0, as along a wall, by QR, which takes
    three times as long."""
    try:
        return linear.eliminateSequential(ordering)
    except RuntimeError:
        return linear.eliminateSequential(ordering, gtsam.EliminateQR)


def _ties(linear: gtsam.GaussianFactorGraph) -> np.ndarray:
    """(p - 1, 2) pairs of keys that would join all p parts of a graph: METIS ends the process where it falls apart."""
    keys = [linear.at(k).keys() for k in range(linear.size())]
    ends = np.array([(key[0], key[-1]) for key in keys])
    count = int(ends.max()) + 1
    joined = sparse.coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    _, first = np.unique(connected_components(joined, directed=False)[1], return_index=True)
    return np.column_stack([first[:-1], first[1:]])


@dataclass(frozen=True, slots=True)
class _Eliminated:
    """Variables in the order of their elimination, each given the later ones that its equations name."""

    place: np.ndarray  # (N,) int, each key's place in this order
    later: list[np.ndarray]  # for each place the (s,) places, ascending, of the variables that its equations name
    # for each place (6, 6), upper triangular, and `S`: (6, 6 s): R x + S x_later = noise of variance 1
    R: list[np.ndarray]
    S: list[np.ndarray]

    @classmethod
    def of(cls, bayes_net: gtsam.GaussianBayesNet) -> "_Eliminated":
        conditionals = [bayes_net.at(k) for k in range(bayes_net.size())]
        keys = [np.array(conditional.keys(), np.intp) for conditional in conditionals]
        place = np.empty(len(keys), np.intp)
        place[[key[0] for key in keys]] = np.arange(len(keys))
        later, S = [], []
        for key, conditional in zip(keys, conditionals, strict=True):
            named = place[key[1:]]
            order = np.argsort(named)
            later.append(named[order])
            S.append(conditional.S().reshape(_SIZE, -1, _SIZE)[:, order].reshape(_SIZE, -1))
        return cls(place, later, [conditional.R().copy() for conditional in conditionals], S)

    def marginals(self, pairs: np.ndarray) -> Marginals:
        """From the last variable to the first: what a variable and those that it names are unsure of together."""
        count = len(self.place)
        single, across = np.empty((count, _SIZE, _SIZE)), np.empty((len(pairs), _SIZE, _SIZE))
        asked = self._asked(pairs)
        parents = [int(later[0]) if len(later) else -1 for later in self.later]
        children = Counter(parents)
        together: dict[int, np.ndarray] = {}  # of each variable and those that it names
        for k in range(count - 1, -1, -1):
            later, parent = self.later[k], parents[k]
            own = np.empty((_SIZE * (1 + len(later)),) * 2)
            if parent >= 0:
                own[_SIZE:, _SIZE:] = self._part(together[parent], parent, later)
            self._fill(own, k)
            single[k] = own[:_SIZE, :_SIZE]
            for other, pair, first in asked.get(k, ()):
                at = _SIZE * (1 + int(np.searchsorted(later, other)))
                block = own[:_SIZE, at : at + _SIZE]
                across[pair] = block if first else block.T
            if children[k]:
                together[k] = own
            if parent >= 0:
                children[parent] -= 1
                if not children[parent]:
                    del together[parent]
        return Marginals(single[self.place], across)

    def _fill(self, own: np.ndarray, k: int) -> None:
        """The rows and columns of variable k, from the rest of `own`, which is known."""
        root = np.linalg.inv(self.R[k])
        gain = -root @ self.S[k]
        across = gain @ own[_SIZE:, _SIZE:]
        own[:_SIZE, _SIZE:], own[_SIZE:, :_SIZE] = across, across.T
        own[:_SIZE, :_SIZE] = root @ root.T + across @ gain.T

    def _part(self, together: np.ndarray, parent: int, later: np.ndarray) -> np.ndarray:
        """What the parent knows together, of these variables alone."""
        known = np.concatenate([[parent], self.later[parent]])
        if len(known) == len(later):  # all of it
            return together
        chosen = np.searchsorted(known, later)
        blocks = together.reshape(len(known), _SIZE, len(known), _SIZE)[chosen][:, :, chosen]
        return blocks.reshape(_SIZE * len(later), -1)

    def _asked(self, pairs: np.ndarray) -> dict[int, list[tuple[int, int, bool]]]:
        """The pairs by the place of their first variable: the other's place, the pair, and whether i is the first."""
        asked: dict[int, list[tuple[int, int, bool]]] = defaultdict(list)
        for pair, (a, b) in enumerate(self.place[pairs].tolist()):
            asked[min(a, b)].append((max(a, b), pair, a < b))
        return asked
