"""A survey's pairs registered by whoever works, with a journal of those that are done."""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from sonarmap.slam.execute.executor import Executor, this_process
from sonarmap.slam.execute.journal import Journal, JournalEntry, storable
from sonarmap.slam.execute.pair_text import from_text, signature_from_text
from sonarmap.slam.execute.scan_key import ScanKey, joined_key, scan_key
from sonarmap.slam.execute.timings import PairTime, Timings
from sonarmap.slam.execute.worker import PairJob, PairWorker, TimedText, Worker
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.result import Registrar
from sonarmap.spectral.scan import Scan

Progress = Callable[[int, int, str], None]


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
    """The progress."""

    planned: int
    report: Progress | None
    done: int = 0

    def step(self, text: str) -> None:
        self.done += 1
        if self.report is not None:
            self.report(self.done, self.planned, text)


@dataclass(frozen=True, slots=True)
class _Work:
    """A piece of work, as the journal knows it.

    Attributes:
        kind: what is computed; it decides the result, as what is expected of a pair does.
        scans: of these.
        parse: raises a ValueError, LookupError or TypeError where a text is no result.
    """

    kind: str
    scans: tuple[ScanKey, ...]
    parse: Callable[[str], Any]

    @property
    def label(self) -> str:
        return " - ".join(scan.name for scan in self.scans)

    @classmethod
    def of(cls, job: PairJob | ScanKey) -> "_Work":
        """A pair to register, or a scan whose signature is wanted."""
        if isinstance(job, ScanKey):
            return cls("signature", (job,), signature_from_text)
        kind, expected = "pair", job.expected
        if expected is not None:
            numbers = np.concatenate([expected.rotation, expected.translation, expected.sigmas])
            kind = f"pair expected at {numbers.tolist()}"
        return cls(kind, (job.target, job.source), from_text)


@dataclass(frozen=True, slots=True)
class _Kept:
    """Results that earlier runs computed.

    Attributes:
        journal: None for none.
        method: a key of all that decides a result beside the scans.
    """

    journal: Journal | None
    method: str

    def text(self, work: _Work) -> TimedText | None:
        """The result of a piece of work; what cannot be read is the journal's fault.

        A failure is taken over only where the scans have the same names, as these are in its words.
        """
        entry = None if self.journal is None else self.journal.entry(self._key(work))
        if self.journal is None or entry is None:
            return None
        try:
            parsed = work.parse(entry.content)
        except (ValueError, LookupError, TypeError) as error:
            raise self.journal.unusable(str(error)) from error
        failed = work.parse is from_text and parsed[0] is None
        return None if failed and entry.label != storable(work.label) else TimedText(entry.content, entry.seconds)

    def add(self, works: Sequence[_Work], texts: Sequence[TimedText]) -> None:
        if self.journal is not None:
            done = zip(works, texts, strict=True)
            self.journal.add(
                [JournalEntry(self._key(work), work.label, text.content, text.seconds) for work, text in done]
            )

    def _key(self, work: _Work) -> str:
        return joined_key(work.kind, self.method, *(scan.content for scan in work.scans))


class PairRunner:
    """Registers the pairs of one survey.

    Args:
        execution: who works, and the journal.
        scans: the survey's; each is read once for its key, and again when a worker needs it.
        planned: number of progress steps known from the beginning, beside pairs.
        progress: called with (steps done, steps planned so far, text) after each step, or None.
    """

    def __init__(self, execution: Execution, scans: Sequence[Scan], planned: int, progress: Progress | None) -> None:
        self._execution, self._all_scans = execution, scans
        self._kept = _Kept(execution.journal, execution.method)
        self._scans = [scan_key(scan) for scan in scans]
        self._number = {scan: k for k, scan in enumerate(self._scans)}
        self._numbers = list(range(len(scans)))  # of `_scans`, among all
        self._steps = _Steps(planned, progress)

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
        self._steps.step(stage)

    def end_stage(self, stage: str) -> None:
        """Count the time since the last stage ended to this stage."""
        self._execution.timings.end_stage(stage)

    def release(self) -> None:
        """Free the prepared scans."""
        self._execution.worker.release()

    def register(self, candidates: Sequence[Candidate]) -> list[RegisteredPair]:
        """Register scan j to scan i for every candidate, in their order.

        A pair that cannot be registered has a failure instead. What the journal holds is not registered again.

        Raises:
            InputError, DeviceError: the machine or the workers failed, or the journal cannot be used.
        """
        self._steps.planned += len(candidates)
        jobs = [PairJob(self._scans[pair.i], self._scans[pair.j], pair.expected) for pair in candidates]
        pairs: dict[int, RegisteredPair] = {}
        for n, text, from_journal in self._results(self._execution.worker.register, jobs):
            pairs[n] = candidates[n].registered(*from_text(text.content))
            i, j = (self._numbers[k] for k in candidates[n].scans)
            self._execution.timings.pairs.append(PairTime(i, j, text.seconds, from_journal))
            self._steps.step(f"{_Work.of(jobs[n]).label}: {_result_in_words(pairs[n])}")
        self.end_stage("pairs registered")
        return [pairs[n] for n in range(len(candidates))]

    def signatures(self) -> list[np.ndarray | None]:
        """Every scan's signature, (K,) float32; None for a scan that cannot be prepared.

        Raises:
            InputError, DeviceError: the machine or the workers failed, or the journal cannot be used.
        """
        results = self._results(self._execution.worker.signatures, self._scans)
        signatures = {n: signature_from_text(text.content) for n, text, _ in results}
        self.end_stage("signatures computed")
        return [signatures[n] for n in range(len(self._scans))]

    def _results(
        self, task: Callable[..., list[TimedText]], jobs: Sequence[PairJob] | Sequence[ScanKey]
    ) -> Iterator[tuple[int, TimedText, bool]]:
        """Every job's number and result, and whether it is the journal's; these come first, the others once done."""
        works = [_Work.of(job) for job in jobs]
        kept = [self._kept.text(work) for work in works]
        yield from ((n, text, True) for n, text in enumerate(kept) if text is not None)
        missing = [n for n, text in enumerate(kept) if text is None]
        executor = self._execution.executor

        def sources(piece: Sequence[PairJob | ScanKey]) -> tuple[dict[ScanKey, Any]]:
            scans = dict.fromkeys(scan for job in piece for scan in _Work.of(job).scans)
            return ({scan: executor.transport.source(scan, partial(self._load, scan)) for scan in scans},)

        for indices, texts in executor.run(task, [jobs[n] for n in missing], more=sources):
            done = [missing[k] for k in indices]
            self._kept.add([works[n] for n in done], texts)
            yield from ((n, text, False) for n, text in zip(done, texts, strict=True))

    def _load(self, scan: ScanKey) -> Scan:
        return self._all_scans[self._number[scan]]


def _result_in_words(pair: RegisteredPair) -> str:
    if pair.registration is None:
        return f"failed: {pair.failure}"
    verdict = "accepted" if pair.accepted else "refused by the registration"
    return f"{verdict}: {pair.registration.reason or 'no reason given'}"
