"""Possible edges: the hypotheses of a registration, for the inference about the whole survey."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.result import Registration

_MIN_PROBABILITY = 0.05  # of a possible edge
_DEFAULT_PROBABILITY = 0.9  # of an accepted hypothesis whose method states none
_MAX_PROBABILITY = 0.999  # of any hypothesis: one pair alone is never certain
_MAX_SCANS_APART = 5  # of a hypothesis that may contradict the chain
_MIN_WEIGHT = -log(2 / 3)  # of a refused hypothesis that agrees with the chain: wrong with a probability of 2/3
_MIN_BRIDGE_WEIGHT = -log(0.2)  # of a single bridge that joins components
MIN_JOINT_WEIGHT = -log(0.05)  # of agreeing pairs that join components: all wrong with a probability of 0.05


@dataclass(frozen=True, slots=True)
class Support:
    """The evidence for a possible edge."""

    pairs: int = 1  # number of agreeing pairs in its group, its own included
    # of the group: negative logarithm of the probability that all of it is wrong; of hypotheses that were sought where
    # they are expected the best alone, as one wrong expectation misleads all of them
    weight: float = 0.0
    leading: bool = False  # whether its group is clearly heavier than the next between the same components
    sigmas: float = float("nan")  # Mahalanobis distance from its component's chain; NaN if it joins two components
    agrees: bool = False  # whether this is within the bound; False if it joins two components
    elsewhere: bool = False  # whether a direction is unconstrained and the component's chain far away


@dataclass(frozen=True, slots=True)
class PossibleEdge:
    """One hypothesis for the transform between two scans, and its support."""

    # i, j: target and source, i < j
    i: int
    j: int
    registration: Registration  # the hypothesis
    rank: int = 0  # 0 for the registration itself, 1 and more for its alternatives
    near: bool = False  # whether the scans are close in time, so that they certainly overlap
    expected: bool = False  # whether it was sought only where the motion or an estimate expects it
    support: Support = Support()  # by the other pairs, once they are compared

    @property
    def scans(self) -> tuple[int, int]:
        """(i, j)."""
        return self.i, self.j

    @property
    def accepted(self) -> bool:
        """Whether the registration accepts this hypothesis by itself."""
        return self.registration.accepted

    @property
    def probability(self) -> float:
        """That it is right and constrained in all directions, by its registration; at most 0.999."""
        probability = self.registration.probability * self.registration.fixed
        if not np.isfinite(probability):
            probability = _DEFAULT_PROBABILITY if self.accepted else 0.0
        return min(max(probability, 0.0), _MAX_PROBABILITY)

    @property
    def placed(self) -> bool:
        """Whether it is the registration itself with an accepted place; a direction may be unconstrained."""
        return self.rank == 0 and self.registration.placed

    @property
    def counts(self) -> bool:
        """Whether it supports hypotheses that agree with it; nearly all agree with an unconstrained one."""
        return self.accepted or self.probability >= _MIN_PROBABILITY

    @property
    def weight(self) -> float:
        """Negative logarithm of the probability that it is wrong."""
        return -log(1 - self.probability)

    @property
    def joins_parts(self) -> bool:
        """Whether it joins two components; else it lies within one."""
        return bool(np.isnan(self.support.sigmas))

    @property
    def fault(self) -> str:
        """Why it cannot be an edge; "" if it can."""
        try:
            self.edge()
        except InputError as error:
            return str(error)
        return ""

    def edge(self) -> Edge:
        """Its edge in a graph.

        Raises:
            InputError: its covariance is not positive definite.
        """
        return Edge(self.i, self.j, self.registration, "sequential" if self.j == self.i + 1 else "loop")

    @property
    def may_be_taken(self) -> bool:
        """Whether its support is enough for the optimizer to get it."""
        return self.may_join if self.joins_parts else self._may_lie_within

    @property
    def may_join(self) -> bool:
        """Whether it may join two components: at least two pairs agree, or it is an accepted bridge."""
        confirmed = self.support.pairs >= 2 and self.support.weight >= MIN_JOINT_WEIGHT
        bridge = self.accepted and self.near and self.weight >= _MIN_BRIDGE_WEIGHT
        return self.support.leading and (confirmed or bridge)

    @property
    def _may_lie_within(self) -> bool:
        """Whether it may be an edge within the component of both of its scans.

        An accepted hypothesis that agrees with the chain may. A refused one that agrees needs another agreeing pair,
        and has to be probable, or refused only for an unconstrained direction. One that contradicts the chain has to be
        accepted, with another agreeing pair, and of scans so close in time that few edges of the chain can be wrong;
        the graph then decides. Farther apart, several pairs can be wrong in the same way at places of similar shape.
        """
        if self.support.elsewhere:
            return False
        if self.support.agrees:
            probable = self.weight >= _MIN_WEIGHT or self.placed
            return self.accepted or (probable and self.support.leading and self.support.pairs >= 2)
        return self.accepted and self.support.pairs >= 2 and self.j - self.i <= _MAX_SCANS_APART


def possible_edges(pair: RegisteredPair) -> list[PossibleEdge]:
    """The hypotheses of a pair, its registration and alternatives, that are accepted or probable enough."""
    if pair.registration is None:
        return []
    hypotheses: Sequence[Registration] = (pair.registration, *pair.registration.alternatives)
    possible = [
        PossibleEdge(pair.i, pair.j, each, rank, pair.role != "loop", pair.is_sought)
        for rank, each in enumerate(hypotheses)
    ]
    return [edge for edge in possible if edge.counts or edge.placed]
