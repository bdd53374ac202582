"""The registration of a survey's pairs by an executor, with a journal of results and with timings."""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import astuple, dataclass, field
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from sonarmap.slam.execute.executor import Executor, this_process
from sonarmap.slam.execute.journal import Journal, JournalEntry, storable
from sonarmap.slam.execute.pair_text import from_text, signature_from_text
from sonarmap.slam.execute.transport import ScanKey, joined_key, scan_key
from sonarmap.slam.execute.worker import Job, PairJob, PairWorker, TimedText, Worker
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.result import Registrar
from sonarmap.spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class PairTime:
    # target, source: indices of the scans among all of the survey
    target: int
    source: int
    seconds: float  # duration when it was computed, with the preparation of its scans [s]
    from_journal: bool  # whether an earlier run computed it


@dataclass(slots=True)
class Timings:
    pairs: list[PairTime] = field(default_factory=list)  # in the order in which they were done
    stages: dict[str, float] = field(default_factory=dict)  # duration of every stage [s], by its name
    _stage_start: float = field(default_factory=perf_counter)

    @property
    def from_journal(self) -> int:
        """Number of pairs that an earlier run computed."""
        return sum(pair.from_journal for pair in self.pairs)

    def end_stage(self, name: str) -> None:
        """Add the time since the end of the last stage to this one, which may occur several times."""
        now = perf_counter()
        self.stages[name] = self.stages.get(name, 0.0) + now - self._stage_start
        self._stage_start = now


Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, slots=True)
class Execution:
    """How a survey's pairs are registered, and where the results are kept."""

    worker: PairWorker  # registers pairs; a `WorkerSpec` if the executor's workers are other processes
    executor: Executor = field(default_factory=this_process)  # runs the worker
    journal: Journal | None = None  # keeps results for later runs; None for no journal
    method: str = ""  # the journal's key of all that determines the result of a pair except its scans
    timings: Timings = field(default_factory=Timings)  # updated during the run

    @classmethod
    def here(cls, registrar: Registrar, prepared: int) -> "Execution":
        """Execution in this process without a journal; `prepared` is the number of prepared scans to keep, >= 2."""
        return cls(Worker(registrar, prepared))


@dataclass(slots=True)
class _Steps:
    planned: int
    report: Progress | None
    done: int = 0

    def step(self, text: str) -> None:
        self.done += 1
        if self.report is not None:
            self.report(self.done, self.planned, text)


class PairRunner:
    """Registers the pairs of one survey.

    Args:
        execution: the worker, its executor, and the journal.
        scans: the survey's; each is read once for its key, and again when a worker needs it.
        planned: number of progress steps known from the beginning, beside pairs.
        progress: called with (steps done, steps planned so far, text) after each step, or None.
    """

    def __init__(self, execution: Execution, scans: Sequence[Scan], planned: int, progress: Progress | None) -> None:
        self._execution, self._all_scans = execution, scans
        self._scans = [scan_key(scan) for scan in scans]
        self._number = {scan: k for k, scan in enumerate(self._scans)}
        self._numbers = list(range(len(scans)))  # index of each of `_scans` among all scans
        self._steps = _Steps(planned, progress)

    def of(self, chosen: Sequence[int]) -> "PairRunner":
        """A runner for some of the scans, which it numbers 0, 1, ...; it continues the progress."""
        part = copy(self)
        part._scans = [self._scans[k] for k in chosen]
        part._numbers = [self._numbers[k] for k in chosen]
        return part

    def beside(self, versions: Sequence[Scan], numbers: Sequence[int]) -> "PairRunner":
        """A runner with versions of some scans (`numbers`) after all others; it continues the progress."""
        more, keys = copy(self), [scan_key(scan) for scan in versions]
        more._number = {key: len(self._all_scans) + n for n, key in enumerate(keys)} | self._number
        more._all_scans = [*self._all_scans, *versions]
        more._scans, more._numbers = [*self._scans, *keys], [*self._numbers, *(self._numbers[k] for k in numbers)]
        return more

    @property
    def workers(self) -> int:
        """The number of workers, which is the number of pairs registered at a time."""
        return self._execution.executor.workers

    def step_done(self, stage: str) -> None:
        """End a stage that is one step of the progress."""
        self.end_stage(stage)
        self._steps.step(stage)

    def end_stage(self, stage: str) -> None:
        """Add the time since the end of the last stage to this one."""
        self._execution.timings.end_stage(stage)

    def register(self, candidates: Sequence[Candidate]) -> list[RegisteredPair]:
        """Register scan j to scan i for every candidate, in their order.

        A pair that cannot be registered has a failure instead. Results in the journal are used, not computed again.

        Raises:
            InputError, DeviceError: the machine or the workers failed, or the journal cannot be used.
        """
        self._steps.planned += len(candidates)
        jobs = [PairJob(self._scans[pair.i], self._scans[pair.j], pair.expected) for pair in candidates]
        pairs: dict[int, RegisteredPair] = {}
        for n, text, from_journal in self._results(jobs):
            pairs[n] = candidates[n].registered(*from_text(text.content))
            i, j = (self._numbers[k] for k in candidates[n].scans)
            self._execution.timings.pairs.append(PairTime(i, j, text.seconds, from_journal))
            self._steps.step(f"{_label(jobs[n])}: {_result_in_words(pairs[n])}")
        self.end_stage("pairs registered")
        return [pairs[n] for n in range(len(candidates))]

    def signatures(self) -> list[np.ndarray | None]:
        """Every scan's signature, (K,) float32; None for a scan that cannot be prepared. Raises as `register`."""
        signatures = {n: signature_from_text(text.content) for n, text, _ in self._results(self._scans)}
        self.end_stage("signatures computed")
        return [signatures[n] for n in range(len(self._scans))]

    def _results(self, jobs: Sequence[Job]) -> Iterator[tuple[int, TimedText, bool]]:
        """Every job's index and result, and whether it is from the journal; those come first, others once done."""
        journaled = [self._journaled(job) for job in jobs]
        yield from ((n, text, True) for n, text in enumerate(journaled) if text is not None)
        missing = [n for n, text in enumerate(journaled) if text is None]
        executor, journal = self._execution.executor, self._execution.journal

        def sources(piece: Sequence[Job]) -> tuple[dict[ScanKey, Any]]:
            scans = dict.fromkeys(scan for job in piece for scan in _scans_of(job))
            return ({scan: executor.transport.source(scan, partial(self._load, scan)) for scan in scans},)

        pieces = executor.run(self._execution.worker.run, [jobs[n] for n in missing], more=sources)
        for indices, texts in pieces:
            done = list(zip((missing[k] for k in indices), texts, strict=True))
            if journal is not None:
                entries = [(jobs[n], text) for n, text in done]
                journal.add([JournalEntry(self._key(job), _label(job), *astuple(text)) for job, text in entries])
            yield from ((n, text, False) for n, text in done)

    def _journaled(self, job: Job) -> TimedText | None:
        """The journal's result of a job; None if there is none.

        A failure is used only if the scans have the same names, as its message has these.
        """
        journal = self._execution.journal
        entry = None if journal is None else journal.entry(self._key(job))
        if entry is None:
            return None
        failed = not isinstance(job, ScanKey) and from_text(entry.content)[0] is None
        if failed and entry.label != storable(_label(job)):
            return None
        return TimedText(entry.content, entry.seconds)

    def _key(self, job: Job) -> str:
        """The journal's key of all that determines a job's result, including a pair's expected pose."""
        kind, expected = ("signature", None) if isinstance(job, ScanKey) else ("pair", job.expected)
        if expected is not None:
            T = expected.T_target_source
            numbers = np.concatenate([T.rotation.as_quat(), T.translation, expected.covariance.ravel()])
            kind = f"pair expected at {numbers.tolist()}"
        return joined_key(kind, self._execution.method, *(scan.content for scan in _scans_of(job)))

    def _load(self, scan: ScanKey) -> Scan:
        return self._all_scans[self._number[scan]]


def _scans_of(job: Job) -> tuple[ScanKey, ...]:
    return (job,) if isinstance(job, ScanKey) else (job.target, job.source)


def _label(job: Job) -> str:
    return " - ".join(scan.name for scan in _scans_of(job))


def _result_in_words(pair: RegisteredPair) -> str:
    if pair.registration is None:
        return f"failed: {pair.failure}"
    verdict = "accepted" if pair.accepted else "doubtful"
    return f"{verdict}: {pair.registration.reason or 'no reason given'}"
