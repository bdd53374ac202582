"""Executors, which run work in this process or in several processes of this machine."""

from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from functools import partial
from itertools import islice
from multiprocessing.reduction import ForkingPickler
from typing import Any, TypeVar

from scipy.spatial.transform import RigidTransform

_Result = TypeVar("_Result")

# Neighboring jobs share prepared scans, so a worker gets this many at a time; they are lost when it is killed.
_JOBS_TOGETHER = 4
_QUEUED_PER_WORKER = 2  # pieces of work, so that no worker is ever idle


def _by_matrix(T: RigidTransform) -> tuple[Callable[..., RigidTransform], tuple[Any]]:
    return partial(RigidTransform, normalize=False), (T.as_matrix(),)


# Transforms on their way to other processes keep all bits: SciPy's pickling normalizes them, which changes the last.
ForkingPickler.register(RigidTransform, _by_matrix)


@dataclass(frozen=True, slots=True)
class Executor:
    """Runs a task on many pieces of work."""

    pool: ProcessPoolExecutor | None = None  # of `processes.spawned`; None for this process
    workers: int = 1  # number of the pool's processes

    def run(self, task: Callable[..., _Result], arguments: Iterable[tuple[Any, ...]]) -> Generator[tuple[int, _Result]]:
        """Run a task on every piece of work, and yield its number and its result as soon as it is done.

        Args:
            task: it is pickled where workers are processes.
            arguments: the task's for each piece, in the order in which they are begun; taken when the piece is begun.

        Raises:
            Exception: whatever the task raises; or a worker was lost.
        """
        if self.pool is None:
            yield from ((number, task(*piece)) for number, piece in enumerate(arguments))
            return
        waiting = enumerate(arguments)
        running: dict[Future[_Result], int] = {}
        while True:
            for number, piece in islice(waiting, _QUEUED_PER_WORKER * self.workers - len(running)):
                running[self.pool.submit(task, *piece)] = number
            if not running:
                return
            done = wait(running, return_when=FIRST_COMPLETED).done
            for future in sorted(done, key=_has_failed):  # results are yielded before an error is raised
                yield running.pop(future), future.result()

    def pieces(self, jobs: int) -> list[range]:
        """Jobs in pieces of neighbors: small enough for every worker to get some, and single in this process."""
        size = min(_JOBS_TOGETHER, max(1, jobs // (_QUEUED_PER_WORKER * self.workers))) if self.pool else 1
        return [range(start, min(start + size, jobs)) for start in range(0, jobs, size)]


def _has_failed(future: Future[Any]) -> bool:
    return future.cancelled() or future.exception() is not None
