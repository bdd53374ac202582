"""Executors, which run work in this process or in several processes of this machine."""

from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures import Executor as Pool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing.reduction import ForkingPickler
from typing import Any, TypeVar

from scipy.spatial.transform import RigidTransform

from sonarmap.slam.execute.processes import spawned

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")

# Neighboring jobs share prepared scans, so a worker gets this many at a time; they are lost when it is killed.
JOBS_TOGETHER = 4
_QUEUED_PER_WORKER = 2  # pieces of work, so that no worker is ever idle


def _by_matrix(T: RigidTransform) -> tuple[Callable[..., RigidTransform], tuple[Any]]:
    return partial(RigidTransform, normalize=False), (T.as_matrix(),)


# Transforms on their way to other processes keep all bits: SciPy's pickling normalizes them, which changes the last.
ForkingPickler.register(RigidTransform, _by_matrix)


@dataclass(frozen=True, slots=True)
class Executor:
    """Runs a task on many jobs."""

    pool: Pool  # what runs a piece of work
    workers: int  # how many there are
    most_together: int | None = None  # upper limit of the number of jobs in a piece of work; None for none

    def run(
        self,
        task: Callable[..., list[_Result]],
        jobs: Sequence[_Job],
        together: int = JOBS_TOGETHER,
        more: Callable[[Sequence[_Job]], tuple[Any, ...]] = lambda _: (),
    ) -> Generator[tuple[range, list[_Result]]]:
        """Run a task on all jobs, and yield the results of each piece of work as soon as it is done.

        Args:
            task: takes the jobs of a piece of work and what `more` returns for them, and returns a result for each job;
                it is pickled where workers are processes.
            jobs: in the order in which they are begun.
            together: largest number of jobs in a piece of work.
            more: returns the task's further arguments for the jobs of a piece; called when the piece is begun.

        Yields:
            the indices of some of the jobs, and their results.

        Raises:
            InputError: workers cannot be made or were lost.
            Exception: whatever the task raises.
        """
        pieces = _pieces(len(jobs), self.workers, min(together, self.most_together or together))
        running: dict[Future[list[_Result]], range] = {}
        while pieces or running:
            most_running = _QUEUED_PER_WORKER * self.workers
            while pieces and len(running) < most_running:
                piece = pieces.popleft()
                some = jobs[piece.start : piece.stop]
                future = self.pool.submit(task, some, *more(some))
                running[future] = piece
                if future.done():  # in this process: the caller gets the result before the next piece is begun
                    break
            done = wait(running, return_when=FIRST_COMPLETED).done
            for future in sorted(done, key=_has_failed):  # results are yielded before an error is raised
                yield running.pop(future), future.result()


def this_process() -> Executor:
    """An executor that runs every job in this process, one after the other."""
    return Executor(_Immediate(), 1, most_together=1)


@contextmanager
def processes(workers: int, begin: Callable[..., None] | None = None, *arguments: Any) -> Iterator[Executor]:
    """Several new processes of this machine, for as long as the block lasts.

    Args:
        begin: what each process calls first, with `arguments`; before it the process has loaded no library.
    """
    with spawned(workers, begin, *arguments) as pool:
        yield Executor(pool, workers)


def _pieces(jobs: int, workers: int, together: int) -> deque[range]:
    """The jobs in pieces of neighbors, small enough for every worker to get some."""
    size = min(together, max(1, jobs // (_QUEUED_PER_WORKER * workers)))
    return deque(range(start, min(start + size, jobs)) for start in range(0, jobs, size))


def _has_failed(future: Future[Any]) -> bool:
    return future.cancelled() or future.exception() is not None


class _Immediate(Pool):
    """Runs a job when it is submitted; exceptions are raised at once."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future
