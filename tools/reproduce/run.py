"""An experiment from its first job to its last, going on where an earlier run was stopped."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

from tools.progress import Follow
from tools.reproduce.crew import Crew, Work
from tools.reproduce.experiment import Experiment, Outcome
from tools.reproduce.journal import Done, Journal
from tools.reproduce.provenance import Provenance


@dataclass(frozen=True, slots=True)
class Result:
    """All jobs of an experiment.

    Attributes:
        outcomes: by job, in the order of the experiment's jobs.
        took: the seconds of every job, in the same order; jobs of earlier runs took theirs then [s].
    """

    outcomes: Mapping[str, Outcome]
    took: Mapping[str, float]

    @property
    def seconds(self) -> float:
        """Of all jobs together, whenever they were done [s]."""
        return sum(self.took.values())


@dataclass(frozen=True, slots=True)
class Way:
    """How to run.

    Attributes:
        fresh: do every job, whatever the journals have.
        crew: does the jobs; None: this process.
        methods: by method, where its rows come from: its jobs have a journal of their own.
    """

    fresh: bool = False
    crew: Crew | None = None
    methods: Mapping[str, Provenance] = field(default_factory=dict)


def run(
    experiment: Experiment,
    provenance: Provenance,
    folder: Path,
    follow: Follow,
    way: Way | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> Result:
    """Do the jobs that are not yet done; stopping it at any moment loses no more than the jobs under way.

    Args:
        experiment: what to do.
        provenance: of it, which says whose rows may be taken over.
        folder: where the journals are.
        follow: how to tell of the progress.
        way: how to run.
        tell: takes a sentence about jobs that were done before.

    Raises:
        InputError, DeviceError: from a job, or a journal cannot be written.
    """
    way = way or Way()
    jobs = list(dict.fromkeys(experiment.jobs()))
    journals = _journals(jobs, provenance, folder, way)
    waiting = [job for job in jobs if job not in journals[job].done]
    if len(waiting) < len(jobs):
        before = f"{len(jobs) - len(waiting)} of {len(jobs)} jobs were done"
        tell(f"{experiment.name}: going on: {before}" if waiting else f"{experiment.name}: {before} before")
    if waiting:
        with follow(experiment.name, len(waiting)) as step, closing(_work(experiment, waiting, way.crew)) as work:
            for job, outcome, seconds in work:
                journals[job].add(job, outcome, seconds)
                step(job)
    done: dict[str, Done] = {job: journals[job].done[job] for job in jobs}
    return Result({job: one.outcome for job, one in done.items()}, {job: one.seconds for job, one in done.items()})


def _journals(jobs: Sequence[str], provenance: Provenance, folder: Path, way: Way) -> dict[str, Journal]:
    """By job: its method's, or one for all."""
    kept: dict[str, Journal] = {}
    for name in dict.fromkeys(_method(job, way) for job in jobs):
        kept[name] = Journal(folder, way.methods.get(name, provenance), way.fresh)
    return {job: kept[_method(job, way)] for job in jobs}


def _method(job: str, way: Way) -> str:
    last = job.rpartition("/")[2]
    return last if last in way.methods else ""


def _work(experiment: Experiment, jobs: Sequence[str], crew: Crew | None) -> Generator[Work]:
    """Each job as it gets done; by a crew in no certain order."""
    if crew is not None:
        groups: dict[str, list[str]] = {}
        for job in jobs:
            groups.setdefault(job.rpartition("/")[0] or job, []).append(job)
        with closing(crew.do(list(groups.values()))) as batches:
            for batch in batches:
                yield from batch
        return
    for job in jobs:
        start = perf_counter()
        outcome = experiment.run(job)
        yield job, outcome, perf_counter() - start
