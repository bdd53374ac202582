"""An experiment from its first job to its last, going on where an earlier run was stopped."""

import json
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.executor import processes, this_process
from sonarmap.slam.execute.journal import Journal, JournalEntry
from sonarmap.tools.files.writers.tables import to_json
from sonarmap.tools.lab.progress import Follow
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row
from sonarmap.tools.lab.reproduce.provenance import Provenance
from sonarmap.tools.lab.reproduce.worker import JobResult, WorkerProcesses, begin, run_in_worker, run_jobs

JOURNAL = "journal.sqlite"


@dataclass(frozen=True, slots=True)
class Result:
    """All jobs of an experiment."""

    outcomes: Mapping[str, Outcome]  # by job, in the order of the experiment's jobs
    job_seconds: Mapping[str, float]  # how long every job took when it was run, in the same order [s]

    @property
    def rows(self) -> list[Row]:
        """Of all jobs."""
        return [row for outcome in self.outcomes.values() for row in outcome.rows]

    @property
    def times(self) -> list[Row]:
        """Of all jobs, the rows of times."""
        return [row for outcome in self.outcomes.values() for row in outcome.seconds]


@dataclass(frozen=True, slots=True)
class RunOptions:
    """How to run an experiment."""

    fresh: bool = False  # run every job, whatever the journal holds
    workers: WorkerProcesses | None = None  # processes that share the jobs; None for this process alone


def run(
    experiment: Experiment,
    provenance: Provenance,
    folder: Path,
    follow: Follow,
    options: RunOptions | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Result:
    """Run the jobs that are not in the journal of the folder; a run that is stopped loses only the jobs that are being
    run. Jobs of another provenance are run again; `say` takes a sentence about jobs that the journal held.

    Every outcome goes through the journal's text, so that results are the same whether a run was stopped or not.

    Raises:
        InputError, DeviceError: from a job, or the journal cannot be used.
    """
    options = options or RunOptions()
    jobs = list(dict.fromkeys(experiment.jobs))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write {folder}: {error.strerror or error}; choose another output folder") from error
    with Journal(folder / JOURNAL) as journal:
        keys = {job: provenance.key(job) for job in jobs}
        missing = [job for job in jobs if options.fresh or journal.entry(keys[job]) is None]
        if journal.damaged:
            say(f"{experiment.name}: {journal.damaged} results in {journal.path} are damaged: their jobs are run again")
        if len(missing) < len(jobs):
            done = f"{len(jobs) - len(missing)} of {len(jobs)} jobs were done"
            say(f"{experiment.name}: going on: {done}" if missing else f"{experiment.name}: {done} before")
        if missing:
            with follow(experiment.name, len(missing)) as step, _running(experiment, missing, options) as groups:
                for results in groups:
                    journal.add([_entry(keys[result.job], experiment.name, result) for result in results])
                    for result in results:
                        step(result.job)
        entries = {job: journal.entry(key) for job, key in keys.items()}
        return Result(
            {job: _outcome(journal, entry) for job, entry in entries.items()},
            {job: entry.seconds for job, entry in entries.items() if entry},
        )


@contextmanager
def _running(
    experiment: Experiment, jobs: Sequence[str], options: RunOptions
) -> Generator[Generator[Sequence[JobResult]]]:
    """Groups of results, as soon as each group is done; by workers in no certain order."""
    if options.workers is None:
        with closing(this_process().run(partial(run_jobs, experiment), [(job,) for job in jobs], together=1)) as pieces:
            yield (group for _, results in pieces for group in results)
        return
    batches: dict[str, list[str]] = {}
    for job in jobs:  # those that differ in their last part alone share work
        batches.setdefault(job.rpartition("/")[0] or job, []).append(job)
    with (
        processes(options.workers.count, begin, options.workers) as executor,
        closing(executor.run(run_in_worker, list(batches.values()), together=1)) as pieces,
    ):
        yield (group for _, results in pieces for group in results)


def _entry(key: str, name: str, result: JobResult) -> JournalEntry:
    content = {"rows": result.outcome.rows, "seconds": result.outcome.seconds}
    return JournalEntry(key, f"{name} {result.job}", json.dumps(to_json(content), allow_nan=False), result.seconds)


def _outcome(journal: Journal, entry: JournalEntry | None) -> Outcome:
    """What an entry holds; numbers come back bit by bit, and what is no finite number comes back as NaN."""
    if entry is None:
        raise journal.unusable("an entry that was written is gone")
    try:
        content: dict[str, Any] = json.loads(entry.content)
        rows, seconds = (
            tuple({name: math.nan if value is None else value for name, value in row.items()} for row in content[part])
            for part in ("rows", "seconds")
        )
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise journal.unusable(str(error)) from error
    return Outcome(rows, seconds)
