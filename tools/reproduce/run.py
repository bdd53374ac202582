"""An experiment from its first job to its last, going on where an earlier run was stopped."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from tools.follow import Follow
from tools.reproduce.experiment import Experiment, Outcome
from tools.reproduce.journal import Journal
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


def run(
    experiment: Experiment,
    provenance: Provenance,
    folder: Path,
    follow: Follow,
    fresh: bool = False,
    tell: Callable[[str], None] = lambda _: None,
) -> Result:
    """Do the jobs that are not yet done; stopping it at any moment loses no more than the job under way.

    Args:
        experiment: what to do.
        provenance: of it, which says whose rows may be taken over.
        folder: where the journal is.
        follow: how to tell of the progress.
        fresh: do every job, whatever the journal has.
        tell: takes a sentence about jobs that were done before.

    Raises:
        InputError, DeviceError: from a job, or the journal cannot be written.
    """
    journal = Journal(folder, provenance, fresh)
    jobs = list(dict.fromkeys(experiment.jobs()))
    waiting = [job for job in jobs if job not in journal.done]
    if len(waiting) < len(jobs):
        before = f"{len(jobs) - len(waiting)} of {len(jobs)} jobs were done"
        tell(f"{experiment.name}: going on: {before}" if waiting else f"{experiment.name}: {before} before")
    if waiting:
        with follow(experiment.name, len(waiting)) as step:
            for job in waiting:
                start = perf_counter()
                outcome = experiment.run(job)
                journal.add(job, outcome, perf_counter() - start)
                step(job)
    done = {job: journal.done[job] for job in jobs}
    return Result({job: one.outcome for job, one in done.items()}, {job: one.seconds for job, one in done.items()})
