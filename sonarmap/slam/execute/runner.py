"""The registration of a survey's pairs by an executor, with a journal of results and with timings."""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from sonarmap.slam.execute.executor import Executor
from sonarmap.slam.execute.job import Job, KeyedScan, PairJob, job_key, job_label
from sonarmap.slam.execute.journal import Journal, JournalEntry
from sonarmap.slam.execute.pair_text import from_text, signature_from_text
from sonarmap.slam.execute.worker import PairWorker, TimedText
from sonarmap.slam.pair import Candidate, RegisteredPair
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
    executor: Executor = field(default_factory=Executor)  # runs the worker
    journal: Journal | None = None  # keeps results for later runs; None for no journal
    method: str = ""  # the journal's key of all that determines the result of a pair except its scans
    timings: Timings = field(default_factory=Timings)  # updated during the run


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
        scans: the survey's. Their arrays may be on disk: they are read for their keys, and again by each worker that
            needs them.
        planned: number of progress steps known from the beginning, beside pairs.
        progress: called with (steps done, steps planned so far, text) after each step, or None.
    """

    def __init__(self, execution: Execution, scans: Sequence[Scan], planned: int, progress: Progress | None) -> None:
        self._execution = execution
        self._scans = [KeyedScan.of(scan) for scan in scans]
        self._numbers = list(range(len(scans)))  # index of each of `_scans` among the survey's
        self._steps = _Steps(planned, progress)

    def of(self, chosen: Sequence[int]) -> "PairRunner":
        """A runner for some of the scans, which it numbers 0, 1, ...; it continues the progress."""
        part = copy(self)
        part._scans = [self._scans[k] for k in chosen]
        part._numbers = [self._numbers[k] for k in chosen]
        return part

    def beside(self, versions: Sequence[Scan], numbers: Sequence[int]) -> "PairRunner":
        """A runner with versions of some scans (`numbers`) after all others; it continues the progress."""
        more = copy(self)
        more._scans = [*self._scans, *map(KeyedScan.of, versions)]
        more._numbers = [*self._numbers, *(self._numbers[k] for k in numbers)]
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
            self._steps.step(f"{job_label(jobs[n])}: {_result_in_words(pairs[n])}")
        self.end_stage("pairs registered")
        return [pairs[n] for n in range(len(candidates))]

    def signatures(self) -> list[np.ndarray | None]:
        """Every scan's signature, (K,) float32; None for a scan that cannot be prepared. Raises as `register`."""
        signatures = {n: signature_from_text(text.content) for n, text, _ in self._results(self._scans)}
        self.end_stage("signatures computed")
        return [signatures[n] for n in range(len(self._scans))]

    def _results(self, jobs: Sequence[Job]) -> Iterator[tuple[int, TimedText, bool]]:
        """Every job's index and result, and whether it is from the journal; those come first, others once done."""
        keys = [job_key(job, self._execution.method) for job in jobs]
        journaled = [self._journaled(key, job) for key, job in zip(keys, jobs, strict=True)]
        yield from ((n, text, True) for n, text in enumerate(journaled) if text is not None)
        missing = [n for n, text in enumerate(journaled) if text is None]
        executor, journal = self._execution.executor, self._execution.journal
        pieces = [[missing[k] for k in piece] for piece in executor.pieces(len(missing))]
        arguments = (([jobs[n] for n in piece],) for piece in pieces)
        for number, texts in executor.run(self._execution.worker.run, arguments):
            done = list(zip(pieces[number], texts, strict=True))
            if journal is not None:
                entries = (JournalEntry(keys[n], job_label(jobs[n]), text.content, text.seconds) for n, text in done)
                journal.add(list(entries))
            yield from ((n, text, False) for n, text in done)

    def _journaled(self, key: str, job: Job) -> TimedText | None:
        """The journal's result of a job; None if there is none.

        A failure is used only if the scans have the same names, as its message has these.
        """
        journal = self._execution.journal
        entry = None if journal is None else journal.entry(key)
        if entry is None:
            return None
        failed = not isinstance(job, KeyedScan) and from_text(entry.content)[0] is None
        if failed and entry.label != job_label(job):
            return None
        return TimedText(entry.content, entry.seconds)


def _result_in_words(pair: RegisteredPair) -> str:
    if pair.registration is None:
        return f"failed: {pair.failure}"
    verdict = "accepted" if pair.accepted else "doubtful"
    return f"{verdict}: {pair.registration.reason or 'no reason given'}"
