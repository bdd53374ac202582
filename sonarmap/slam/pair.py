"""Two scans of a survey, stage by stage: a candidate, a registered pair, and a pair with its verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.tie import ByHand
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.result import Registration

Role = Literal["sequential", "bridge", "loop"]
# Prefix of the failure of a pair that is not the fault of its scans.
DEFECT = "an error of the method, not of the scans: "


@dataclass(frozen=True, slots=True)
class Candidate:
    # i, j: target and source, i < j
    i: int
    j: int
    role: Role  # "sequential" (consecutive), "bridge" (over a gap) or "loop" (any others)
    predicted_overlap: float = float("nan")  # expected before it is registered, 0..1; NaN where no estimate exists
    alike: float = float("nan")  # distance of the scans' signatures, without a unit; NaN where these were not compared
    expected: ExpectedPose | None = None  # as a bound on the registration; None without

    @property
    def scans(self) -> tuple[int, int]:
        return self.i, self.j

    @property
    def is_sought(self) -> bool:
        """Whether it is registered only where the motion or an estimate expects it; one that is wrong misleads many
        pairs. Instruments that measured both scans mislead the pairs of these alone."""
        return self.expected is not None and not self.expected.by_instruments

    def renumbered(self, number: Mapping[int, int]) -> Self:
        """The pair with other numbers for its scans."""
        return replace(self, i=number[self.i], j=number[self.j])

    def registered(self, registration: Registration | None = None, failure: str = "") -> "RegisteredPair":
        """The pair with a registration or a failure, in place of any earlier ones."""
        candidate = {name: getattr(self, name) for name in Candidate.__slots__}
        return RegisteredPair(**candidate, registration=registration, failure=failure)


@dataclass(frozen=True, slots=True)
class RegisteredPair(Candidate):
    registration: Registration | None = None  # the result; None where the pair could not be registered
    failure: str = ""  # why it could not

    @property
    def accepted(self) -> bool:
        return self.registration is not None and self.registration.accepted

    @property
    def placed(self) -> bool:
        """Whether the place of the registration is probable enough, though a direction may be unconstrained."""
        return self.registration is not None and self.registration.placed

    @property
    def is_defect(self) -> bool:
        """Whether it failed by an error of the method, though both scans could be prepared."""
        return self.failure.startswith(DEFECT)


@dataclass(frozen=True, slots=True)
class Pair(RegisteredPair):
    """A registered pair with the verdict of the whole survey.

    Attributes:
        i, j: target and source, i < j.
        role: "sequential" (consecutive), "bridge" (over a gap) or "loop" (any others).
        predicted_overlap: expected before it was registered, 0..1; NaN where no estimate existed.
        alike: distance of the scans' signatures, without a unit; NaN where these were not compared.
        expected, registration, failure: as of a `Candidate` and a `RegisteredPair`.
        edge: its edge in the graph, from the registration or one of its alternatives; None if it was not kept.
        reason: in words, why it was kept or not.
        agreeing: number of other pairs that close a consistent cycle with it.
        sigmas_from_estimate: its distance from the chain, before loops [sigmas]; NaN where it has none.
        residual: its distance from the final poses [sigmas], under the covariance of a kept pair, or under the sum of
            the pair's and the poses' covariances of any other; NaN where it has none.
        by_hand: a person's verdict (`slam.tie`), which overrides the survey's; "" for none.
        note: why, in the person's words.
        contradicted: of a pair kept by hand, chi-squared of six numbers by which the rest of the survey contradicts it,
            without a unit (`slam.decide.verdict`); NaN of any other.
    """

    edge: Edge | None = None
    reason: str = ""
    agreeing: int = 0
    sigmas_from_estimate: float = float("nan")
    residual: float = float("nan")
    by_hand: ByHand = ""
    note: str = ""
    contradicted: float = float("nan")

    @property
    def kept(self) -> bool:
        return self.edge is not None


def require_any_registered(pairs: Sequence[RegisteredPair]) -> None:
    """Raise InputError if every pair failed: then the set-up is wrong, or all scans but one."""
    if pairs and all(pair.registration is None for pair in pairs):
        raise InputError(
            f"none of the {len(pairs)} pairs that were tried could be registered; the first failed: {pairs[0].failure}"
        )
