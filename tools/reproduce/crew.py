"""Jobs done by several processes at once. No library is imported here, as a process that is begun sets how
many threads libraries take before it loads them."""

import os
from collections.abc import Generator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from importlib import import_module
from time import perf_counter
from typing import TYPE_CHECKING, Any

from slam.execute.processes import spawned

if TYPE_CHECKING:
    from tools.reproduce.experiment import Experiment, Outcome
    from tools.reproduce.experiments import Request

Work = tuple[str, "Outcome", float]  # a job, what it found, and how long it took [s]

_mine: "Experiment | None" = None  # of a process of the crew


@dataclass(frozen=True, slots=True)
class Crew:
    """Processes that each make the same experiment, with a device of its own.

    Attributes:
        workers: how many, at least 1.
        module: that has the experiment's `create`.
        request: what to make, without a device.
        selector: of the device, as `choose_device` takes it.
    """

    workers: int
    module: str
    request: "Request"
    selector: str | None

    def do(self, groups: Sequence[Sequence[str]]) -> Generator[list[Work]]:
        """Do groups of jobs, each by one process, and yield what each group found as soon as it is done.

        Closed or interrupted it ends the processes, and what they are at is lost.

        Raises:
            InputError, DeviceError: from a job, or a process ended before its time.
        """
        with spawned(self.workers, _begin, self) as pool:
            for done in as_completed([pool.submit(_do, tuple(group)) for group in groups]):
                yield done.result()


def _begin(crew: Crew) -> None:
    """Make the experiment, in a process of the crew."""
    global _mine
    os.environ.setdefault("OMP_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // crew.workers)))
    from dataclasses import replace

    from kernels.opencl.device import choose_device

    create: Any = import_module(crew.module).create
    _mine = create(replace(crew.request, device=choose_device(crew.selector)))


def _do(jobs: tuple[str, ...]) -> list[Work]:
    """The jobs of one group, one after the other."""
    assert _mine is not None, "the process was not begun"
    found = []
    for job in jobs:
        start = perf_counter()
        outcome = _mine.run(job)
        found.append((job, outcome, perf_counter() - start))
    return found
