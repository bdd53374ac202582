"""A survey's pairs registered by whoever works, with a journal of those that are done."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from sonarmap.slam.execute.executor import Executor, this_process
from sonarmap.slam.execute.journal import Journal, JournalEntry, storable
from sonarmap.slam.execute.pair_text import from_text, signature_from_text
from sonarmap.slam.execute.scan_key import ScanKey, joined_key, scan_key
from sonarmap.slam.execute.timings import PairTime, Timings
from sonarmap.slam.execute.worker import PairJob, PairWorker, TimedText, Worker
from sonarmap.slam.pair import Pair
from sonarmap.spectral.result import Registrar, Registration
from sonarmap.spectral.scan import Scan

Progress = Callable[[int, int, str], None]
_Job = TypeVar("_Job")
_Parsed = TypeVar("_Parsed")


@dataclass(frozen=True, slots=True)
class Execution:
    """Who registers a survey's pairs, and where the results are kept.

    Attributes:
        worker: what registers; where the executor's workers are other processes, a `WorkerSpec`.
        executor: what runs it.
        journal: where results are kept and looked up; None for nowhere.
        method: a key of all that decides the result of a pair beside its scans, for the journal.
        timings: how long it took, added to as it runs.
    """

    worker: PairWorker
    executor: Executor = field(default_factory=this_process)
    journal: Journal | None = None
    method: str = ""
    timings: Timings = field(default_factory=Timings)

    @classmethod
    def here(cls, registrar: Registrar, prepared: int) -> "Execution":
        """This process, without a journal; `prepared` is how many prepared scans to keep, at least 2."""
        return cls(Worker(registrar, prepared))


@dataclass(slots=True)
class _Steps:
    """Of the progress."""

    planned: int
    done: int = 0


class PairRunner:
    """Registers the pairs of one survey.

    Args:
        execution: who works, and the journal.
        scans: the survey's; each is read once for its key, and again when a worker needs it.
        planned: number of progress steps known from the beginning, beside pairs.
        progress: called with (steps done, steps planned so far, text) after each step, or None.
    """

    def __init__(self, execution: Execution, scans: Sequence[Scan], planned: int, progress: Progress | None) -> None:
        self._execution = execution
        self._all_scans = scans
        self._scans = [scan_key(scan) for scan in scans]
        self._number = {scan: k for k, scan in enumerate(self._scans)}
        self._numbers = list(range(len(scans)))  # of `_scans`, among all
        self._progress = progress
        self._steps = _Steps(planned)

    def of(self, chosen: Sequence[int]) -> "PairRunner":
        """The same for some of the scans, which are then numbered 0, 1, ...; their progress goes on."""
        part = copy(self)
        part._scans = [self._scans[k] for k in chosen]
        part._numbers = [self._numbers[k] for k in chosen]
        return part

    @property
    def workers(self) -> int:
        """How many there are now, at least 1: so many pairs are registered at a time."""
        return max(1, self._execution.executor.worker_count())

    def step_done(self, stage: str) -> None:
        """End a stage that is one step of the progress."""
        self.end_stage(stage)
        self._step(stage)

    def end_stage(self, stage: str) -> None:
        """Count the time since the last stage ended to this stage."""
        self._execution.timings.end_stage(stage)

    def release(self) -> None:
        """Free the prepared scans."""
        self._execution.worker.release()

    def register(self, candidates: Sequence[Pair]) -> list[Pair]:
        """Register scan j to scan i for every candidate: the same pairs, in their order, with their registrations.

        A pair that cannot be registered has a failure instead. What the journal holds is not registered again.

        Raises:
            InputError, DeviceError: the machine or the workers failed, or the journal cannot be used.
        """
        self._steps.planned += len(candidates)
        all_jobs = [PairJob(self._scans[pair.i], self._scans[pair.j], pair.expected) for pair in candidates]
        texts = [self._pair_in_journal(job) for job in all_jobs]
        pairs = list(candidates)
        for n, text in enumerate(texts):
            if text is not None:
                pairs[n] = self._registered(candidates[n], text, from_journal=True)
        missing = [n for n, text in enumerate(texts) if text is None]
        jobs = [all_jobs[n] for n in missing]
        for indices, results in self._run(self._execution.worker.register, jobs, _scans_of_pairs):
            self._keep([self._pair_entry(jobs[k], text) for k, text in zip(indices, results, strict=True)])
            for k, text in zip(indices, results, strict=True):
                pairs[missing[k]] = self._registered(candidates[missing[k]], text, from_journal=False)
        self.end_stage("pairs registered")
        return pairs

    def signatures(self) -> list[np.ndarray | None]:
        """Every scan's signature, (K,) float32; None for a scan that cannot be prepared.

        Raises:
            InputError, DeviceError: the machine or the workers failed, or the journal cannot be used.
        """
        texts = [self._signature_in_journal(scan) for scan in self._scans]
        missing = [k for k, text in enumerate(texts) if text is None]
        jobs = [self._scans[k] for k in missing]
        for indices, results in self._run(self._execution.worker.signatures, jobs, iter):
            self._keep([self._signature_entry(jobs[k], text) for k, text in zip(indices, results, strict=True)])
            for k, text in zip(indices, results, strict=True):
                texts[missing[k]] = text.content
        self.end_stage("signatures computed")
        return [signature_from_text(text) for text in texts if text is not None]

    def _run(
        self,
        task: Callable[..., list[TimedText]],
        jobs: Sequence[_Job],
        scans_of: Callable[[Sequence[_Job]], Iterable[ScanKey]],
    ) -> Iterator[tuple[range, list[TimedText]]]:
        """The results of all jobs, piece by piece; `scans_of` says which scans a piece needs."""
        executor = self._execution.executor

        def sources(piece: Sequence[_Job]) -> tuple[dict[ScanKey, Any]]:
            scans = dict.fromkeys(scans_of(piece))
            return ({scan: executor.transport.source(scan, partial(self._load, scan)) for scan in scans},)

        return executor.run(task, jobs, more=sources)

    def _load(self, scan: ScanKey) -> Scan:
        return self._all_scans[self._number[scan]]

    def _registered(self, candidate: Pair, text: TimedText, from_journal: bool) -> Pair:
        """The pair with its result, counted as done."""
        registration, failure = from_text(text.content)
        i, j = candidate.i, candidate.j
        time = PairTime(self._numbers[i], self._numbers[j], text.seconds, from_journal)
        self._execution.timings.pairs.append(time)
        self._step(f"{_label(self._scans[i], self._scans[j])}: {_result_in_words(registration, failure)}")
        return replace(candidate, registration=registration, failure=failure)

    def _step(self, text: str) -> None:
        self._steps.done += 1
        if self._progress is not None:
            self._progress(self._steps.done, self._steps.planned, text)

    def _keep(self, entries: Sequence[JournalEntry]) -> None:
        if self._execution.journal is not None:
            self._execution.journal.add(entries)

    def _entry(self, kind: str, scans: Sequence[ScanKey]) -> JournalEntry | None:
        journal = self._execution.journal
        return None if journal is None else journal.entry(self._key(kind, scans))

    def _key(self, kind: str, scans: Sequence[ScanKey]) -> str:
        return joined_key(kind, self._execution.method, *(scan.content for scan in scans))

    def _pair_entry(self, job: PairJob, text: TimedText) -> JournalEntry:
        scans = job.target, job.source
        return JournalEntry(self._key(_kind(job), scans), _label(*scans), text.content, text.seconds)

    def _signature_entry(self, scan: ScanKey, text: TimedText) -> JournalEntry:
        return JournalEntry(self._key("signature", (scan,)), _label(scan), text.content, text.seconds)

    def _pair_in_journal(self, job: PairJob) -> TimedText | None:
        """A failure is taken over only where the scans have the same names, as these are in its words."""
        scans = job.target, job.source
        entry = self._entry(_kind(job), scans)
        if entry is None:
            return None
        registration, _ = self._parsed(entry, from_text)
        if registration is None and entry.label != storable(_label(*scans)):
            return None
        return TimedText(entry.content, entry.seconds)

    def _signature_in_journal(self, scan: ScanKey) -> str | None:
        entry = self._entry("signature", (scan,))
        if entry is None:
            return None
        self._parsed(entry, signature_from_text)
        return entry.content

    def _parsed(self, entry: JournalEntry, parse: Callable[[str], _Parsed]) -> _Parsed:
        """An entry's content; what cannot be read is the journal's fault."""
        try:
            return parse(entry.content)
        except (ValueError, LookupError, TypeError) as error:
            assert self._execution.journal is not None
            raise self._execution.journal.unusable(str(error)) from error


def _scans_of_pairs(jobs: Sequence[PairJob]) -> list[ScanKey]:
    return [scan for job in jobs for scan in (job.target, job.source)]


def _kind(job: PairJob) -> str:
    """Of the journal's entry: what is expected of a pair decides its result."""
    expected = job.expected
    if expected is None:
        return "pair"
    numbers = np.concatenate([expected.rotation, expected.translation, expected.sigmas])
    return f"pair expected at {numbers.tolist()}"


def _label(*scans: ScanKey) -> str:
    return " - ".join(scan.name for scan in scans)


def _result_in_words(registration: Registration | None, failure: str) -> str:
    if registration is None:
        return f"failed: {failure}"
    verdict = "accepted" if registration.accepted else "refused by the registration"
    return f"{verdict}: {registration.reason or 'no reason given'}"
