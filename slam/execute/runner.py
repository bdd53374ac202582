"""Having the pairs of a survey registered."""

from collections.abc import Callable, Sequence

import numpy as np

from slam.execute.attempt import Attempt, from_text
from slam.execute.executor import Crew, alone
from slam.execute.scan_key import keyed
from slam.execute.timings import PairTime
from slam.execute.worker import Worker
from spectral.result import Registrar
from spectral.scan import Scan

Progress = Callable[[int, int, str], None]


class PairRunner:
    """Has the pairs of a survey registered, and keeps what comes of them.

    Args:
        registrar: the method; where a crew is given, the one that its recipe makes.
        scans: the survey's.
        prepared: without a crew, how many prepared scans to keep, at least 2.
        planned: number of steps known from the beginning that are no pairs of the first call to `register`.
        progress: called with (steps done, steps planned so far, words) after each step, or None.
        crew: who does the work, and where the journal is; None does it here, and keeps no journal.
    """

    def __init__(
        self,
        registrar: Registrar,
        scans: Sequence[Scan],
        prepared: int,
        planned: int,
        progress: Progress | None,
        crew: Crew | None = None,
    ) -> None:
        self._signs = hasattr(registrar, "signature")
        self._scans = [keyed(scan) for scan in scans]
        self._crew = crew or alone(Worker(registrar, prepared))
        self._progress = progress
        self._done, self._planned = 0, planned

    def tell(self, words: str) -> None:
        """One step is done; what it took since the last is told under these words in the account."""
        self._crew.account.end_stage(words)
        self._step(words)

    def end_stage(self, words: str) -> None:
        """What it took since the last stage is told under these words in the account."""
        self._crew.account.end_stage(words)

    def forget(self) -> None:
        """Free the prepared scans."""
        self._crew.hands.forget()

    def register(self, wanted: Sequence[tuple[int, int]]) -> list[Attempt]:
        """Register scan j to scan i for every pair (i, j); what came of each, in their order.

        A pair that fails is told, not raised. What the journal holds is not registered again.

        Raises:
            InputError, DeviceError: the machine or the crew failed, or the journal cannot be used.
        """
        self._planned += len(wanted)
        journal, attempts = self._crew.journal, self._found(wanted)
        missing = [n for n in range(len(wanted)) if n not in attempts]
        jobs = [(self._scans[i], self._scans[j]) for i, j in (wanted[n] for n in missing)]
        for which, done in self._crew.register(jobs):
            if journal is not None:
                journal.add_pairs([jobs[k] for k in which], done)
            for k, one in zip(which, done, strict=True):
                attempts[missing[k]] = from_text(one.attempt)
                self._note(*wanted[missing[k]], attempts[missing[k]], one.seconds, found=False)
        self._crew.account.end_stage("pairs registered")
        return [attempts[n] for n in range(len(wanted))]

    def signatures(self) -> list[np.ndarray | None]:
        """Of every scan, (K,) float32; None for one that cannot be prepared, and for all where the method has none.

        Raises:
            InputError, DeviceError: the machine or the crew failed, or the journal cannot be used.
        """
        if not self._signs:
            return [None] * len(self._scans)
        journal = self._crew.journal
        found = [journal.signature(scan) if journal is not None else None for scan in self._scans]
        missing = [k for k, one in enumerate(found) if one is None]
        jobs = [self._scans[k] for k in missing]
        for which, signed in self._crew.sign(jobs):
            if journal is not None:
                journal.add_scans([jobs[k] for k in which], signed)
            for k, one in zip(which, signed, strict=True):
                found[missing[k]] = one
        self._crew.account.end_stage("scans signed")
        return [one.signature for one in found if one is not None]

    def _found(self, wanted: Sequence[tuple[int, int]]) -> dict[int, Attempt]:
        """Of the pairs those that the journal holds, by their place."""
        attempts = {}
        for n, (i, j) in enumerate(wanted):
            found = self._crew.journal.pair(self._scans[i], self._scans[j]) if self._crew.journal is not None else None
            if found is not None:
                attempts[n] = found.attempt
                self._note(i, j, found.attempt, found.seconds, found=True)
        return attempts

    def _note(self, i: int, j: int, attempt: Attempt, seconds: float, found: bool) -> None:
        """A pair is done."""
        self._crew.account.pairs.append(PairTime(i, j, seconds, found))
        self._step(f"{self._scans[i].name} - {self._scans[j].name}: {_outcome(attempt)}")

    def _step(self, words: str) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._planned, words)


def _outcome(attempt: Attempt) -> str:
    if attempt.registration is None:
        return f"failed: {attempt.failure}"
    verdict = "accepted" if attempt.registration.accepted else "refused by the registration"
    return f"{verdict}: {attempt.registration.reason or 'no reason given'}"
