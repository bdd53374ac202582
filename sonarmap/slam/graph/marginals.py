"""Covariances of single poses and of pairs: blocks of the inverse of a sparse information matrix.

The inverse is dense, but its entries at the nonzeros of the factor follow from one another, from the last eliminated
variable to the first (Takahashi, Fagan and Chin 1973; Kaess and Dellaert, Robotics and Autonomous Systems 2009,
DOI 10.1016/j.robot.2009.06.008). That takes about as long as the elimination; one pass gives all poses and pairs.
"""

from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components


@dataclass(frozen=True, slots=True)
class Marginals:
    """Covariances of N poses' body tangents, rotation first [rad, m]."""

    single: np.ndarray  # (N, 6, 6) of each pose
    across: np.ndarray  # (m, 6, 6) of each requested pair (i, j), the expectation of (error of i) (error of j)'


def marginals(linear: gtsam.GaussianFactorGraph, pairs: np.ndarray) -> Marginals:
    """Covariances of the keys 0..N-1, and cross-covariances of pairs of them.

    Args:
        linear: factors at the optimum, of keys 0..N-1 with six numbers each.
        pairs: (m, 2) int, i and j differ.

    Raises:
        RuntimeError: the factors do not determine every pose.
    """
    extended = linear.clone()
    zeros, weight = np.zeros((1, 6)), gtsam.noiseModel.Unit.Create(1)
    for i, j in np.unique(np.sort(np.concatenate([pairs.reshape(-1, 2), _ties(linear)]), axis=1), axis=0).tolist():
        # adds no information, but makes the elimination keep the block of the pair
        extended.add(gtsam.JacobianFactor(i, zeros, j, zeros, np.zeros(1), weight))
    # nested dissection takes half the time for pairs spread over a plane; METIS crashes on a single key
    ordering = (
        gtsam.Ordering.MetisGaussianFactorGraph
        if linear.keys().size() > 1
        else gtsam.Ordering.ColamdGaussianFactorGraph
    )
    return _Eliminated.of(_eliminated(extended.eliminateSequential, ordering(extended))).marginals(pairs.reshape(-1, 2))


def require_unique(linear: gtsam.GaussianFactorGraph) -> None:
    """Raise RuntimeError where the factors leave a pose undetermined."""
    _eliminated(linear.eliminateMultifrontal, gtsam.Ordering.ColamdGaussianFactorGraph(linear))


def information_of(linear: gtsam.GaussianFactorGraph, count: int) -> sparse.csc_array:
    """(6 N, 6 N) information of factors about `count` = N keys, six rows each."""
    row, column, entry = linear.sparseJacobian_()
    inside = column <= 6 * count  # the last column holds the residuals
    places = row[inside].astype(np.intp) - 1, column[inside].astype(np.intp) - 1
    jacobian = sparse.csc_array((entry[inside], places), shape=(int(row.max()), 6 * count))
    return sparse.csc_array(jacobian.T @ jacobian)


def _eliminated(eliminate: Callable[..., Any], ordering: gtsam.Ordering) -> Any:
    """Elimination by Cholesky; where that takes a pivot 4096 times below its neighbor for 0, as along a wall, by QR,
    which takes three times as long."""
    try:
        return eliminate(ordering)
    except RuntimeError:
        return eliminate(ordering, gtsam.EliminateQR)


def _ties(linear: gtsam.GaussianFactorGraph) -> np.ndarray:
    """(p - 1, 2) pairs of keys that join the p components of a graph: METIS crashes on a disconnected one."""
    keys = [linear.at(k).keys() for k in range(linear.size())]
    ends = np.array([(key[0], key[-1]) for key in keys])
    count = int(ends.max()) + 1
    joined = sparse.coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    _, first = np.unique(connected_components(joined, directed=False)[1], return_index=True)
    return np.column_stack([first[:-1], first[1:]])


@dataclass(frozen=True, slots=True)
class _Eliminated:
    """A Bayes net: variables in the order of elimination, each conditioned on later ones."""

    place: np.ndarray  # (N,) int, each key's place in this order
    later: list[np.ndarray]  # by place, the (s,) places of the variables that it is conditioned on, ascending
    # R, S: by place, (6, 6) upper triangular and (6, 6 s): R x + S x_later = noise of variance 1
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
            S.append(conditional.S().reshape(6, -1, 6)[:, order].reshape(6, -1))
        return cls(place, later, [conditional.R().copy() for conditional in conditionals], S)

    def marginals(self, pairs: np.ndarray) -> Marginals:
        """Covariances of all variables and of pairs of keys, from the last variable to the first."""
        count = len(self.place)
        single, across = np.empty((count, 6, 6)), np.empty((len(pairs), 6, 6))
        pairs_of = self._pairs_by_place(pairs)
        parents = [int(later[0]) if len(later) else -1 for later in self.later]
        children = Counter(parents)
        joints: dict[int, np.ndarray] = {}  # joint covariance of each variable and its later ones
        for k in range(count - 1, -1, -1):
            later, parent = self.later[k], parents[k]
            joint = np.empty((6 * (1 + len(later)),) * 2)
            if parent >= 0:
                joint[6:, 6:] = self._part(joints[parent], parent, later)
            self._fill(joint, k)
            single[k] = joint[:6, :6]
            for other, pair, first in pairs_of.get(k, ()):
                at = 6 * (1 + int(np.searchsorted(later, other)))
                block = joint[:6, at : at + 6]
                across[pair] = block if first else block.T
            if children[k]:
                joints[k] = joint
            if parent >= 0:
                children[parent] -= 1
                if not children[parent]:
                    del joints[parent]
        return Marginals(single[self.place], across)

    def _fill(self, joint: np.ndarray, k: int) -> None:
        """Fill the rows and columns of variable k from the rest of the joint covariance."""
        root = np.linalg.inv(self.R[k])
        gain = -root @ self.S[k]
        across = gain @ joint[6:, 6:]
        joint[:6, 6:], joint[6:, :6] = across, across.T
        joint[:6, :6] = root @ root.T + across @ gain.T

    def _part(self, joint: np.ndarray, parent: int, later: np.ndarray) -> np.ndarray:
        """The parent's joint covariance, restricted to the variables `later`."""
        places = np.concatenate([[parent], self.later[parent]])
        if len(places) == len(later):  # all of it
            return joint
        chosen = np.searchsorted(places, later)
        blocks = joint.reshape(len(places), 6, len(places), 6)[chosen][:, :, chosen]
        return blocks.reshape(6 * len(later), -1)

    def _pairs_by_place(self, pairs: np.ndarray) -> dict[int, list[tuple[int, int, bool]]]:
        """By the place of a pair's first variable: the other's place, the pair's index, and whether i is the first."""
        pairs_of: dict[int, list[tuple[int, int, bool]]] = defaultdict(list)
        for pair, (a, b) in enumerate(self.place[pairs].tolist()):
            pairs_of[min(a, b)].append((max(a, b), pair, a < b))
        return pairs_of
