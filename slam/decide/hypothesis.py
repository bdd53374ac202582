"""Every answer that a registration could not exclude, as something that the whole survey may decide about."""

from dataclasses import dataclass

import numpy as np

from kernels.errors import InputError
from slam.graph.edge import Edge
from spectral.result import Registration

# An answer less probable than this is not followed.
_POSSIBLE = 0.05
# The probability that an accepted answer counts with where its method gives none, and the most that any counts with:
# one pair alone is never sure.
_UNKNOWN, _SUREST = 0.9, 0.999


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """One answer to how two scans lie to each other.

    Attributes:
        i, j: target and source, i < j.
        rank: 0 for the registration itself, from 1 on for its alternatives.
        registration: the answer.
        near: whether the scans follow each other closely, so that they are known to share something.
    """

    i: int
    j: int
    rank: int
    registration: Registration
    near: bool = False

    @property
    def accepted(self) -> bool:
        """Whether the registration believes in it by itself."""
        return self.registration.accepted

    @property
    def weight(self) -> float:
        """How much it speaks for: the negative logarithm of the probability that it is wrong."""
        probability = self.registration.probability
        if not np.isfinite(probability):
            probability = _UNKNOWN if self.accepted else 0.0
        return float(-np.log1p(-min(max(probability, 0.0), _SUREST)))

    @property
    def fault(self) -> str:
        """Why it can be no edge, in words; "" where it can."""
        try:
            self.edge()
        except InputError as error:
            return str(error)
        return ""

    def edge(self) -> Edge:
        """What it contributes to a graph.

        Raises:
            InputError: its covariance is none.
        """
        return Edge(self.i, self.j, self.registration, "sequential" if self.j == self.i + 1 else "loop")


def hypotheses_of(i: int, j: int, registration: Registration, near: bool = False) -> list[Hypothesis]:
    """The registration where it is accepted or possible, and its possible alternatives."""
    answers = [registration, *registration.alternatives]
    return [
        Hypothesis(i, j, rank, answer, near)
        for rank, answer in enumerate(answers)
        if (rank == 0 and answer.accepted) or answer.probability >= _POSSIBLE
    ]
