"""Registering one pair of a survey after the other, and the account of each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from kernels.errors import InputError, SonarmapError
from slam.edge import Edge
from slam.loop_closure import Verdict
from spectral.result import Registrar, Registration
from spectral.scan import Scan

Role = Literal["sequential", "bridge", "loop"]
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, slots=True)
class Pair:
    """One pair of scans that was tried.

    Attributes:
        i, j: target and source.
        role: "sequential" (consecutive), "loop", or "bridge" (over a gap, with no estimate to go by).
        registration: what came of it; None where it raised.
        edge: what it contributes to the graph; None where it was not kept.
        reason: in words, why it was kept or not.
        predicted_overlap: of a loop, by the estimate, 0..1; NaN otherwise.
        sigmas_from_estimate: of a loop, before it was added (Mahalanobis); NaN otherwise.
        residual: of its edge after the optimization [sigmas]; NaN where there is none.
    """

    i: int
    j: int
    role: Role
    registration: Registration | None
    edge: Edge | None
    reason: str
    predicted_overlap: float = float("nan")
    sigmas_from_estimate: float = float("nan")
    residual: float = float("nan")

    @property
    def kept(self) -> bool:
        """Whether it is an edge of the graph."""
        return self.edge is not None


@dataclass(frozen=True, slots=True)
class Attempt:
    """What came of registering a pair.

    Attributes:
        registration: its result; None where it raised.
        failure: why it raised, in words.
    """

    registration: Registration | None
    failure: str = ""


class PairRunner:
    """Prepares scans as pairs ask for them and registers the pairs.

    Prepared scans hold device memory: the `prepared` used last are kept, and one more while the next is prepared.

    Args:
        registrar: the method.
        scans: the survey's.
        prepared: how many prepared scans to keep, at least 2.
        planned: number of steps known from the beginning that are no pairs of the first call to `register`.
        progress: called with (steps done, steps planned so far, words) after each step, or None.
    """

    def __init__(
        self,
        registrar: Registrar,
        scans: Sequence[Scan],
        prepared: int,
        planned: int,
        progress: Progress | None,
    ) -> None:
        self._registrar = registrar
        self._scans = scans
        self._progress = progress
        self._done, self._planned = 0, planned
        self._prepare = lru_cache(maxsize=prepared)(lambda index: registrar.prepare(scans[index]))

    def tell(self, words: str) -> None:
        """One step is done."""
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._planned, words)

    def forget(self) -> None:
        """Free the prepared scans."""
        self._prepare.cache_clear()

    def register(self, wanted: Sequence[tuple[int, int]]) -> list[Attempt]:
        """Register scan j to scan i for every pair (i, j), in their order. A pair that fails is told, not raised."""
        self._planned += len(wanted)
        return [self._attempt(i, j) for i, j in wanted]

    def _attempt(self, i: int, j: int) -> Attempt:
        try:
            registration = self._registrar.register(self._prepare(i), self._prepare(j))
            attempt = Attempt(registration)
            words = accept(registration).reason
        except SonarmapError as error:
            attempt = Attempt(None, str(error))
            words = f"failed: {error}"
        self.tell(f"{self._scans[i].name} - {self._scans[j].name}: {words}")
        return attempt


def weigh(
    i: int,
    j: int,
    role: Role,
    attempt: Attempt,
    judge: Callable[[Registration], Verdict] | None = None,
    predicted_overlap: float = float("nan"),
) -> Pair:
    """Keep a pair or not.

    Args:
        i, j: target and source.
        role: what the pair is for.
        attempt: what came of registering it.
        judge: what decides about keeping it; by default the registration's own acceptance.
        predicted_overlap: for the account.
    """
    if attempt.registration is None:
        return Pair(i, j, role, None, None, f"failed: {attempt.failure}", predicted_overlap)
    try:
        verdict = judge(attempt.registration) if judge else accept(attempt.registration)
        kind = "sequential" if role == "sequential" else "loop"
        edge = Edge(i, j, attempt.registration, kind) if verdict.kept else None
    except SonarmapError as error:
        return Pair(i, j, role, attempt.registration, None, f"failed: {error}", predicted_overlap)
    return Pair(i, j, role, attempt.registration, edge, verdict.reason, predicted_overlap, verdict.sigmas)


def accept(registration: Registration) -> Verdict:
    """The registration's own word."""
    words = registration.reason or "no reason given"
    outcome = "kept" if registration.accepted else "refused by the registration"
    return Verdict(registration.accepted, float("nan"), f"{outcome}: {words}")


def refuse_all_failed(pairs: Sequence[Pair]) -> None:
    """Raise InputError where every pair raised: then it is the set-up that is wrong, or all scans but one."""
    if all(pair.registration is None for pair in pairs):
        why = pairs[0].reason.removeprefix("failed: ")
        raise InputError(f"none of the {len(pairs)} pairs that were tried could be registered; of the first, {why}")
