"""Runs the jobs of an experiment, with a journal to resume after an interruption."""

import json
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.executor import Executor
from sonarmap.slam.execute.journal import Journal, JournalEntry
from sonarmap.slam.execute.processes import spawned
from sonarmap.tools.files.user_file import package_versions
from sonarmap.tools.files.writers.tables import to_json
from sonarmap.tools.lab.bench.timing import count_cores, processor_name
from sonarmap.tools.lab.reproduce.experiments import Experiment, JobResult, Outcome, Row, WorkerProcesses, run_job
from sonarmap.tools.lab.terminal import Follow
from sonarmap.tools.methods.fingerprint import fingerprint, method_sources, method_versions, source_digest
from sonarmap.tools.methods.registry import find_method


@dataclass(frozen=True, slots=True)
class Provenance:
    """Everything that affects the rows of an experiment, and a description of the machine."""

    name: str  # of the experiment
    settings: Mapping[str, Any]  # in JSON types
    sources: str  # digest of the code that affects the rows
    # device, platform: the OpenCL device and its driver
    device: str
    platform: str
    versions: Mapping[str, str | None]  # of Python, the system and the packages
    # processor, cores: of the host; they do not affect the rows
    processor: str
    cores: int
    # method -> digest of everything that affects its rows; empty if jobs do not belong to methods
    methods: Mapping[str, str] = field(default_factory=dict)

    def key(self, job: str) -> str:
        """The digest of everything that affects the rows of a job, without what only affects other methods."""
        whole = [self.settings, self.sources, self.device, self.platform, self.versions]
        return fingerprint([self.name, self.methods.get(job.rpartition("/")[2], whole), job])

    @property
    def place(self) -> str:
        """A short description of the machine; the driver's text is cut before its list of features."""
        host = f"{self.processor}, {self.cores} cores" if self.processor else f"{self.cores} cores"
        driver = self.platform.split("  ")[0].split(",")[0]
        return f"{self.device} ({driver}; {host})"


def provenance(experiment: Experiment, device: Device) -> Provenance:
    """The provenance of an experiment on a device with the running code."""
    sources = source_digest(experiment.sources)
    return Provenance(
        name=experiment.name,
        settings=to_json(vars(experiment.settings)),
        sources=sources,
        device=device.name,
        platform=device.platform,
        versions=package_versions(),
        processor=processor_name(),
        cores=count_cores(),
        methods={name: _method_fingerprint(experiment, name, sources, device) for name in experiment.methods},
    )


def _method_fingerprint(experiment: Experiment, name: str, sources: str, device: Device) -> str:
    """The digest of everything that affects a method's rows, without the device if the method uses none."""
    used = [device.name, device.platform] if "device" in find_method(name).options else None
    deciding = {setting: getattr(experiment.settings, setting) for setting in experiment.deciding}
    return fingerprint([deciding, sources, method_sources(name), method_versions(name), used])


JOURNAL = "journal.sqlite"


@dataclass(frozen=True, slots=True)
class Result:
    """The results of all jobs of an experiment."""

    outcomes: Mapping[str, Outcome]  # by job, in the order of the experiment's jobs
    job_seconds: Mapping[str, float]  # wall time of each job when it was run, in the same order [s]

    @property
    def rows(self) -> list[Row]:
        """The rows of all jobs."""
        return [row for outcome in self.outcomes.values() for row in outcome.rows]

    @property
    def times(self) -> list[Row]:
        """The rows of run times of all jobs."""
        return [row for outcome in self.outcomes.values() for row in outcome.seconds]


@dataclass(frozen=True, slots=True)
class RunOptions:
    """Options of `run`."""

    fresh: bool = False  # ignore the journal and run every job
    workers: WorkerProcesses | None = None  # processes that share the jobs; None: run them in this process


def run(
    experiment: Experiment,
    provenance: Provenance,
    folder: Path,
    follow: Follow,
    options: RunOptions | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Result:
    """Run the jobs that are not in the folder's journal with this provenance.

    Every outcome is written to the journal and read back, so an interruption does not change the results. `say` gets
    messages about jobs in the journal. Raises InputError, DeviceError: a job fails, or the journal cannot be used.
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
            say(f"{experiment.name}: continuing: {done}" if missing else f"{experiment.name}: {done} before")
        if missing:
            with follow(experiment.name, len(missing)) as step, _running(experiment, missing, options) as groups:
                for results in groups:
                    journal.add([_entry(provenance, result) for result in results])
                    for job, *_ in results:
                        step(job)
        entries = {job: journal.entry(key) for job, key in keys.items()}
        return Result(
            {job: _outcome(journal, entry) for job, entry in entries.items()},
            {job: entry.seconds for job, entry in entries.items() if entry},
        )


@contextmanager
def _running(
    experiment: Experiment, jobs: Sequence[str], options: RunOptions
) -> Generator[Generator[Sequence[JobResult]]]:
    """Iterate over groups of results as they are completed; with workers, in any order."""
    if options.workers is None:
        yield ([run_job(experiment, job)] for job in jobs)
        return
    batches: dict[str, list[str]] = {}
    for job in jobs:  # jobs that differ only in their last part share work
        batches.setdefault(job.rpartition("/")[0] or job, []).append(job)
    with spawned(options.workers.count, WorkerProcesses.begin, options.workers) as pool:
        executor = Executor(pool, options.workers.count)
        with closing(executor.run(WorkerProcesses.run, ((batch,) for batch in batches.values()))) as groups:
            yield (group for _, group in groups)


def _entry(provenance: Provenance, result: JobResult) -> JournalEntry:
    job, outcome, seconds = result
    content = json.dumps(to_json(outcome), allow_nan=False)
    return JournalEntry(provenance.key(job), f"{provenance.name} {job}", content, seconds)


def _outcome(journal: Journal, entry: JournalEntry | None) -> Outcome:
    """The outcome in an entry; finite numbers are restored exactly, all others as NaN."""
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
