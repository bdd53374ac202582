"""Registering the pairs of a survey."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from kernels.errors import SonarmapError
from spectral.result import Registrar, Registration
from spectral.scan import Scan

Progress = Callable[[int, int, str], None]


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

    def signatures(self) -> list[np.ndarray | None]:
        """Of every scan, (K,) float32; None for one that cannot be prepared, and for all where the method has none."""
        if not hasattr(self._registrar, "signature"):
            return [None] * len(self._scans)
        found: list[np.ndarray | None] = []
        for k in range(len(self._scans)):
            try:
                found.append(self._registrar.signature(self._prepare(k)))
            except SonarmapError:
                found.append(None)
        return found

    def _attempt(self, i: int, j: int) -> Attempt:
        try:
            registration = self._registrar.register(self._prepare(i), self._prepare(j))
            attempt = Attempt(registration)
            words = _outcome(registration)
        except SonarmapError as error:
            attempt = Attempt(None, str(error))
            words = f"failed: {error}"
        self.tell(f"{self._scans[i].name} - {self._scans[j].name}: {words}")
        return attempt


def _outcome(registration: Registration) -> str:
    verdict = "accepted" if registration.accepted else "refused by the registration"
    return f"{verdict}: {registration.reason or 'no reason given'}"
