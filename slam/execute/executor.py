"""Where work runs: in this process, in several processes of this machine, or on the workers of a Dask cluster."""

import logging
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from concurrent.futures import Executor as Pool
from contextlib import contextmanager
from dataclasses import dataclass
from socket import create_connection
from typing import Any, TypeVar

from kernels.errors import InputError
from slam.execute.processes import spawned

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")

# Neighboring jobs share prepared scans, so that a worker gets a few at a time; so many are lost when it is killed.
JOBS_TOGETHER = 4
# Pieces of work that each worker has queued, so that it is never idle; more would fill a scheduler's memory.
_QUEUED_PER_WORKER = 2
# How long a cluster's scheduler is waited for, and one that has no workers [s].
_PATIENCE = 10.0
# Loggers that print tracebacks where workers or the scheduler are lost.
_NOISY_LOGGERS = (
    *(f"distributed{part}" for part in ("", ".client", ".core", ".comm", ".utils")),
    "tornado.application",
)


@dataclass(frozen=True, slots=True)
class Executor:
    """Runs a task on many jobs.

    Attributes:
        pool: what runs a piece of work.
        worker_count: how many workers there are now.
        most_together: the largest number of jobs in a piece of work, whatever is asked for.
    """

    pool: Pool
    worker_count: Callable[[], int]
    most_together: int | None = None

    def run(
        self,
        task: Callable[[Sequence[_Job]], list[_Result]],
        jobs: Sequence[_Job],
        together: int = JOBS_TOGETHER,
    ) -> Generator[tuple[range, list[_Result]]]:
        """Run a task on all jobs, and yield the results of each piece of work as soon as it is done.

        Args:
            task: takes some of the jobs and returns a result for each; it is pickled where workers are processes.
            jobs: in the order in which they are begun.
            together: most jobs of one piece of work.

        Yields:
            the indices of some of the jobs, and their results.

        Raises:
            InputError: workers cannot be made or were lost.
            Exception: whatever the task raises.
        """
        pieces = _pieces(len(jobs), self.worker_count(), min(together, self.most_together or together))
        running: dict[Future[list[_Result]], range] = {}
        while pieces or running:
            most_running = _QUEUED_PER_WORKER * max(1, self.worker_count())
            while pieces and len(running) < most_running:
                piece = pieces.popleft()
                future = self.pool.submit(task, jobs[piece.start : piece.stop])
                running[future] = piece
                if future.done():  # in this process: the caller keeps the result before the next piece is begun
                    break
            for future in sorted(self._finished(running), key=_has_failed):  # results are kept before an error ends it
                yield running.pop(future), future.result()

    def _finished(self, running: dict[Future[Any], range]) -> set[Future[Any]]:
        """Those that are done, at least one."""
        while not (done := wait(running, _PATIENCE, FIRST_COMPLETED).done):
            if not self.worker_count():
                raise InputError(
                    f"the cluster has had no worker for {_PATIENCE:g} s. Start some; what is done is kept, and the "
                    "same command goes on from there."
                )
        return done


def this_process() -> Executor:
    """Runs every job here, one after the other."""
    return Executor(_Immediate(), lambda: 1, most_together=1)


@contextmanager
def processes(workers: int, begin: Callable[..., None] | None = None, *arguments: Any) -> Iterator[Executor]:
    """Several new processes of this machine, for as long as the block lasts.

    Args:
        workers: how many, at least 1.
        begin: what each process calls first, with `arguments`; before it the process has loaded no library.

    Raises:
        InputError: a process ended before its time.
    """
    with spawned(workers, begin, *arguments) as pool:
        yield Executor(pool, lambda: workers)


@contextmanager
def cluster(address: str, at_end: Callable[[], None] | None = None) -> Iterator[Executor]:
    """The workers of a Dask cluster, for as long as the block lasts.

    Args:
        address: of the scheduler, as in "tcp://10.0.0.5:8786".
        at_end: what every worker calls when the block has ended well.

    Raises:
        InputError: Dask is not installed, the scheduler cannot be reached, has no workers, or was lost; sonarmap is not
            installed on a worker.
    """
    try:
        from dask import config
        from distributed import Client, KilledWorker
        from distributed.comm.core import CommClosedError
    except ImportError as error:
        raise InputError("`scheduler` needs Dask: pip install 'sonarmap[cluster]'") from error
    for name in _NOISY_LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is raised, too
    with config.set({"distributed.comm.timeouts.connect": _PATIENCE}):
        client = _connected(Client, address)
        try:
            yield Executor(client.get_executor(), lambda: len(client.nthreads()))
            if at_end is not None:
                client.run(at_end)
        except KilledWorker as error:
            raise InputError(
                f"workers of the cluster at {address} ended again and again, as happens where memory is short; give "
                "them more, or use a smaller `edge`. What is done is kept, and the same command goes on from there."
            ) from error
        except (CancelledError, CommClosedError, TimeoutError) as error:
            raise InputError(
                f"the scheduler at {address} was lost. What is done is kept, and the same command goes on from there."
            ) from error
        except ImportError as error:
            raise InputError(
                f"a worker of the cluster at {address} cannot load the sonarmap of this machine ({error}). Install the "
                "same version there, with the packages that the method needs."
            ) from error
        finally:
            client.close(timeout=1)


def _connected(connect: Callable[..., Any], address: str) -> Any:
    """A client of the scheduler, once it has a worker."""
    from distributed.comm.addressing import get_address_host_port

    try:
        # tried first by itself, as a client that finds no scheduler leaves threads behind
        create_connection(get_address_host_port(address), _PATIENCE).close()
        client = connect(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address!r} ({error}). Give the address that 'dask scheduler' prints, as in "
            "`scheduler=tcp://10.0.0.5:8786`."
        ) from error
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except (OSError, ValueError) as error:  # its TimeoutError is an OSError
        client.close(timeout=1)
        raise InputError(
            f"the Dask scheduler at {address} has no workers. Start some, as with 'dask worker {address} --nthreads 1'."
        ) from error
    return client


def _pieces(jobs: int, workers: int, together: int) -> deque[range]:
    """The jobs in pieces of neighbors, small enough for every worker to get some."""
    size = min(together, max(1, jobs // (_QUEUED_PER_WORKER * max(1, workers))))
    return deque(range(start, min(start + size, jobs)) for start in range(0, jobs, size))


def _has_failed(future: Future[Any]) -> bool:
    return future.cancelled() or future.exception() is not None


class _Immediate(Pool):
    """Runs a job when it is submitted; what the job raises is raised at once."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future
