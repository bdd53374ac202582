"""Running an experiment's jobs, in this process or in a new one. Only the standard library is imported here, as a new
process sets how many threads libraries use before it loads them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome
    from sonarmap.tools.lab.reproduce.experiments import Request

_experiment: "Experiment | None" = None  # of this process, where it is a worker


@dataclass(frozen=True, slots=True)
class WorkerProcesses:
    """New processes that each make the same experiment, with a device of its own."""

    count: int  # how many, at least 1
    module: str  # has the experiment's `create`, as `create_from` takes it
    request: "Request"  # what to make, without a device
    device: str | None  # as `choose_device` takes it


@dataclass(frozen=True, slots=True)
class JobResult:
    """A job that was run: its key, its outcome, and how long it took [s]."""

    job: str
    outcome: "Outcome"
    seconds: float


def begin(processes: WorkerProcesses) -> None:
    """Make the experiment in a new process."""
    global _experiment
    from sonarmap.kernels.device.device import choose_device
    from sonarmap.tools.lab.reproduce.experiments import create_from

    _experiment = create_from(processes.module, replace(processes.request, device=choose_device(processes.device)))


def run_in_worker(groups: Sequence[Sequence[str]]) -> list[list[JobResult]]:
    """Run groups of jobs by the experiment of this process, which `begin` made."""
    assert _experiment is not None, "`begin` was not called in this process"
    return run_jobs(_experiment, groups)


def run_jobs(experiment: "Experiment", groups: Sequence[Sequence[str]]) -> list[list[JobResult]]:
    """Run the jobs of each group, one after the other."""
    return [[_run(experiment, job) for job in group] for group in groups]


def _run(experiment: "Experiment", job: str) -> JobResult:
    start = perf_counter()
    outcome = experiment.run(job)
    return JobResult(job, outcome, perf_counter() - start)
