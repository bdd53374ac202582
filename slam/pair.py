"""Every pair of a survey that was tried, and what became of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from kernels.errors import InputError
from slam.execute.attempt import Attempt
from slam.graph.edge import Edge
from spectral.result import Registration

Role = Literal["sequential", "bridge", "loop"]


@dataclass(frozen=True, slots=True)
class Trial:
    """A pair that was tried, before the survey has decided about it.

    Attributes:
        i, j: target and source, i < j.
        role: "sequential" (consecutive), "bridge" (over a gap) or "loop" (any others).
        attempt: what came of registering it.
        overlap: expected from the estimate, 0..1; NaN where none told.
        alike: distance of the scans' signatures; NaN where these were not asked.
    """

    i: int
    j: int
    role: Role
    attempt: Attempt
    overlap: float = float("nan")
    alike: float = float("nan")

    @property
    def accepted(self) -> bool:
        """Whether the registration believes in itself."""
        return self.attempt.registration is not None and self.attempt.registration.accepted


@dataclass(frozen=True, slots=True)
class Pair:
    """A pair that was tried, and what became of it.

    Attributes:
        i, j: target and source, i < j.
        role: as a Trial's.
        registration: what came of it; None where it raised.
        edge: what it contributes to the graph, of the registration or of one of its alternatives; None where it was
            not kept.
        reason: in words, why it was kept or not.
        predicted_overlap: expected before it was registered, 0..1; NaN where no estimate told.
        alike: distance of the scans' signatures; NaN where these were not asked.
        agreeing: how many other pairs close a cycle with it, and agree.
        sigmas_from_estimate: its distance from the chain, before loops (Mahalanobis); NaN where that tells nothing.
        residual: its distance from the final poses [sigmas]: of a kept one under its own covariance, of another also
            under the poses'; NaN where the final poses tell nothing.
    """

    i: int
    j: int
    role: Role
    registration: Registration | None
    edge: Edge | None
    reason: str
    predicted_overlap: float = float("nan")
    alike: float = float("nan")
    agreeing: int = 0
    sigmas_from_estimate: float = float("nan")
    residual: float = float("nan")

    @property
    def kept(self) -> bool:
        """Whether it is an edge of the graph."""
        return self.edge is not None


def refuse_all_failed(trials: Sequence[Trial]) -> None:
    """Raise InputError where every pair raised: then it is the set-up that is wrong, or all scans but one."""
    if trials and all(trial.attempt.registration is None for trial in trials):
        why = trials[0].attempt.failure
        raise InputError(f"none of the {len(trials)} pairs that were tried could be registered; of the first, {why}")
