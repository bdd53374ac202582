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
# How the failure begins of a pair that says nothing of its scans.
DEFECT = "an error of the method, not of the scans: "


@dataclass(frozen=True, slots=True)
class Candidate:
    # i, j: target and source, i < j
    i: int
    j: int
    role: Role  # "sequential" (consecutive), "bridge" (over a gap) or "loop" (any others)
    predicted_overlap: float = float("nan")  # expected before it is registered, 0..1; NaN where no estimate exists
    alike: float = float("nan")  # distance of the scans' signatures, without a unit; NaN where these were not compared
    # where the motion expects it, which bounds its registration; None where nothing does
    expected: ExpectedPose | None = None

    @property
    def scans(self) -> tuple[int, int]:
        return self.i, self.j

    def renumbered(self, number: Mapping[int, int]) -> Self:
        """The same with other numbers for its scans."""
        return replace(self, i=number[self.i], j=number[self.j])

    def registered(self, registration: Registration | None = None, failure: str = "") -> "RegisteredPair":
        """With what came of its registration, in place of what came of an earlier one."""
        said = {name: getattr(self, name) for name in Candidate.__slots__}
        return RegisteredPair(**said, registration=registration, failure=failure)


@dataclass(frozen=True, slots=True)
class RegisteredPair(Candidate):
    registration: Registration | None = None  # the result; None where the pair could not be registered
    failure: str = ""  # why it could not
    # of a step that the scans hardly show, where the usual motion has it, as wide as that may be
    guess: Registration | None = None

    @property
    def accepted(self) -> bool:
        return self.registration is not None and self.registration.accepted

    @property
    def placed(self) -> bool:
        """Whether the registration has found the place, though it may leave a direction open there."""
        return self.registration is not None and self.registration.placed

    @property
    def is_defect(self) -> bool:
        """Whether it failed though both scans could be prepared: scans that do not fit are refused."""
        return self.failure.startswith(DEFECT)


@dataclass(frozen=True, slots=True)
class Pair(RegisteredPair):
    """A registered pair with the verdict of the whole survey.

    Attributes:
        i, j: target and source, i < j.
        role: "sequential" (consecutive), "bridge" (over a gap) or "loop" (any others).
        predicted_overlap: expected before it was registered, 0..1; NaN where no estimate existed.
        alike: distance of the scans' signatures, without a unit; NaN where these were not compared.
        expected, registration, failure, guess: as of a `Candidate` and a `RegisteredPair`.
        edge: what it contributes to the graph, of the registration or of one of its alternatives; None where it was
            not kept.
        reason: in words, why it was kept or not.
        agreeing: how many other pairs close a cycle with it, and agree.
        sigmas_from_estimate: its distance from the chain, before loops [sigmas]; NaN where it has none.
        residual: its distance from the final poses [sigmas]: of a kept pair under its own covariance, of another also
            under the poses'; NaN where it has none.
        by_hand: what a person said of it (`slam.tie`), over what the others say; "" where nobody did.
        note: why, in the person's words.
        contradicted: of a pair that is kept by hand, the chi-squared of six numbers, without a unit, that the rest of
            the survey puts against it (`slam.decide.hand`); NaN of any other.
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
    """Refuse a survey of which every pair failed: then the set-up is wrong, or all scans but one."""
    if pairs and all(pair.registration is None for pair in pairs):
        raise InputError(
            f"none of the {len(pairs)} pairs that were tried could be registered; the first failed: {pairs[0].failure}"
        )
