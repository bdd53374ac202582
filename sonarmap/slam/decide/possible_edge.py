"""Every answer that a registration could not exclude, as something that the whole survey may decide about."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.result import Registration

# An answer less probable than this is not followed.
_POSSIBLE = 0.05
# The probability that an accepted answer counts with where its method gives none, and the most that any counts with:
# one pair alone is never sure.
_UNKNOWN, _SUREST = 0.9, 0.999
# Scans at most this far apart in a chain may show that one of its registrations is wrong.
_NEAR_IN_CHAIN = 5
# Weights: of an answer with a probability of a third, of one that is believed alone, and of pairs that are all wrong
# once in twenty times.
_LIKELY, _BELIEVED, _SURE = -log(2 / 3), -log(0.2), -log(0.05)


@dataclass(frozen=True, slots=True)
class Support:
    """What speaks for a possible edge."""

    pairs: int = 1  # how many pairs, its own among them, agree with one another in its group
    weight: float = 0.0  # of the group, the negative logarithm of the probability that all of it is wrong
    leading: bool = False  # whether its group is clearly heavier than the next between the same parts
    sigmas: float = float("nan")  # its distance from its part's own chain (Mahalanobis); NaN where it joins two parts
    agrees: bool = False  # whether that is within the bound; False where it joins two parts
    elsewhere: bool = False  # whether it leaves a direction open along which its part's chain has the scans far off


@dataclass(frozen=True, slots=True)
class PossibleEdge:
    """One answer to how two scans lie to each other, and what speaks for it."""

    # i, j: target and source, i < j
    i: int
    j: int
    registration: Registration  # the answer
    rank: int = 0  # 0 for the registration itself, from 1 on for its alternatives
    near: bool = False  # whether the scans follow each other closely, so that they certainly share something
    support: Support = Support()  # by the other pairs, as far as it is known

    @property
    def scans(self) -> tuple[int, int]:
        """(i, j)."""
        return self.i, self.j

    @property
    def accepted(self) -> bool:
        """Whether the registration accepts this answer by itself."""
        return self.registration.accepted

    @property
    def probability(self) -> float:
        """That it is right and fixed, as its registration has it, at most 0.999."""
        probability = self.registration.probability * self.registration.fixed
        if not np.isfinite(probability):
            probability = _UNKNOWN if self.accepted else 0.0
        return min(max(probability, 0.0), _SUREST)

    @property
    def placed(self) -> bool:
        """Whether it is the registration itself, which has found the place, though it may leave a direction open."""
        return self.rank == 0 and self.registration.placed

    @property
    def counts(self) -> bool:
        """Whether agreement with it speaks for another answer: with what is wide open nearly everything agrees."""
        return self.accepted or self.probability >= _POSSIBLE

    @property
    def weight(self) -> float:
        """How much it counts: the negative logarithm of the probability that it is wrong."""
        return -log(1 - self.probability)

    @property
    def joins_parts(self) -> bool:
        """Whether it would join two parts; else it lies within one."""
        return bool(np.isnan(self.support.sigmas))

    @property
    def fault(self) -> str:
        """Why it cannot be an edge, in words; "" where it can."""
        try:
            self.edge()
        except InputError as error:
            return str(error)
        return ""

    def edge(self) -> Edge:
        """What it contributes to a graph.

        Raises:
            InputError: its covariance is not positive definite.
        """
        return Edge(self.i, self.j, self.registration, "sequential" if self.j == self.i + 1 else "loop")

    @property
    def may_be_taken(self) -> bool:
        """Whether its support is enough to give it to the optimizer."""
        return self.may_join if self.joins_parts else self._may_stand_beside_chain

    @property
    def may_join(self) -> bool:
        """Whether it may join two parts: at least two pairs agree, or it is accepted, of scans close in time."""
        confirmed = self.support.pairs >= 2 and self.support.weight >= _SURE
        believed = self.accepted and self.near and self.weight >= _BELIEVED
        return self.support.leading and (confirmed or believed)

    @property
    def _may_stand_beside_chain(self) -> bool:
        """Whether it may be an edge beside the chain of the part that both of its scans are in.

        An accepted answer that agrees with the chain may. One that agrees without being accepted has to be likely, or
        refused for a direction alone that it leaves open, which the chain holds; and it needs other pairs besides, as
        the chain holds without it. One that contradicts the chain needs other pairs that
        say the same, and scans so close in time that few registrations of the chain can be at fault: then the graph
        decides between them. Farther apart in time it is more likely that a place looks like another, and several
        pairs can be wrong about that alike.
        """
        if self.support.elsewhere:
            return False
        if self.support.agrees:
            likely = self.weight >= _LIKELY or self.placed
            return self.accepted or (likely and self.support.leading and self.support.pairs >= 2)
        return self.accepted and self.support.pairs >= 2 and self.j - self.i <= _NEAR_IN_CHAIN


def possible_edges(pair: RegisteredPair) -> list[PossibleEdge]:
    """The registration of a pair, where it is accepted or possible, and its possible alternatives."""
    if pair.registration is None:
        return []
    answers: Sequence[Registration] = (pair.registration, *pair.registration.alternatives)
    possible = [
        PossibleEdge(pair.i, pair.j, answer, rank, near=pair.role != "loop") for rank, answer in enumerate(answers)
    ]
    return [edge for edge in possible if edge.counts or edge.placed]
