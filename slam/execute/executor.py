"""Who registers a survey's pairs: this process, several of its own, or a Dask cluster."""

import logging
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from socket import create_connection
from typing import Any, TypeVar

from kernels.errors import InputError
from slam.execute.journal import Journal
from slam.execute.processes import spawned
from slam.execute.scan_key import KeyedScan
from slam.execute.timings import Account
from slam.execute.worker import Done, Hands, Recipe, Signed, release

_Job = TypeVar("_Job")
_Found = TypeVar("_Found")

# Neighbors in the list share prepared scans, so that a worker gets a few at a time; so many are lost when it is killed.
_TOGETHER = 4
# Pieces of work that a worker has waiting, so that it need not wait itself; more would fill a scheduler's memory.
_WAITING = 2
# A cluster's scheduler is waited for so long, and so long one that has no workers [s].
_PATIENCE = 10.0
# Loggers that print tracebacks where workers or the scheduler are lost.
_TALKERS = (*(f"distributed{part}" for part in ("", ".client", ".core", ".comm", ".utils")), "tornado.application")


@dataclass(frozen=True, slots=True)
class Crew:
    """An executor, and what it is to do.

    Attributes:
        hands: what does the work; where the executor is another process's, a `Recipe`.
        executor: that runs it.
        count: how many workers there are now.
        together: the most jobs of a piece of work.
        journal: where pairs that are done are kept and looked for; None for nowhere.
        account: of what it took.
    """

    hands: Hands
    executor: Executor
    count: Callable[[], int]
    together: int = _TOGETHER
    journal: Journal | None = None
    account: Account = field(default_factory=Account)

    def register(self, pairs: Sequence[tuple[KeyedScan, KeyedScan]]) -> Generator[tuple[range, list[Done]]]:
        """Register pairs, and yield them as they are done: which of them, and what came of each.

        Raises:
            InputError, DeviceError: the workers cannot be made, or the machine failed.
        """
        return self._spread(self.hands.register, pairs)

    def sign(self, scans: Sequence[KeyedScan]) -> Generator[tuple[range, list[Signed]]]:
        """Sign scans, and yield them as they are done: which of them, and their signatures."""
        return self._spread(self.hands.sign, scans)

    def _spread(
        self, task: Callable[[Sequence[_Job]], list[_Found]], jobs: Sequence[_Job]
    ) -> Generator[tuple[range, list[_Found]]]:
        pieces = _divided(len(jobs), self.count(), self.together)
        waiting: dict[Future[list[_Found]], range] = {}
        while pieces or waiting:
            room = _WAITING * max(1, self.count())
            while pieces and len(waiting) < room:
                piece = pieces.popleft()
                future = self.executor.submit(task, jobs[piece.start : piece.stop])
                waiting[future] = piece
                if future.done():  # it was done here: to be kept before the next is begun
                    break
            for future in self._some(waiting):
                yield waiting.pop(future), future.result()

    def _some(self, waiting: dict[Future[Any], range]) -> set[Future[Any]]:
        """Those that are done, at least one."""
        while not (done := wait(waiting, _PATIENCE, FIRST_COMPLETED).done):
            if not self.count():
                raise InputError(
                    f"no worker of the cluster has been there for {_PATIENCE:g} s. Start some; what is done is kept, "
                    "and the same command goes on from there."
                )
        return done


def alone(hands: Hands) -> Crew:
    """This process."""
    return Crew(hands, _Here(), lambda: 1, together=1)


@contextmanager
def processes(recipe: Recipe, workers: int) -> Iterator[Crew]:
    """Several processes of this machine, each with a registrar of its own.

    Raises:
        InputError: one of them ended before its time.
    """
    with spawned(workers) as pool:
        yield Crew(recipe, pool, lambda: workers)


@contextmanager
def cluster(recipe: Recipe, address: str) -> Iterator[Crew]:
    """The workers of a Dask cluster, each with a registrar of its own.

    Args:
        recipe: of the registrar.
        address: of the scheduler, as in "tcp://10.0.0.5:8786".

    Raises:
        InputError: Dask is not installed, the scheduler cannot be reached, has no workers, or was lost; sonarmap is not
            installed on a worker.
    """
    try:
        from dask import config
        from distributed import Client, KilledWorker
        from distributed.comm.core import CommClosedError
    except ImportError as error:
        raise InputError("--scheduler wants Dask: pip install 'sonarmap[cluster]'") from error
    for name in _TALKERS:
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is raised, too
    with config.set({"distributed.comm.timeouts.connect": _PATIENCE}):
        client = _connected(Client, address)
        try:
            yield Crew(recipe, client.get_executor(), lambda: len(client.nthreads()))
            client.run(release)
        except KilledWorker as error:
            raise InputError(
                f"workers of the cluster at {address} ended again and again, as where memory is short; give them more, "
                "or a smaller --grid. What is done is kept, and the same command goes on from there."
            ) from error
        except (CancelledError, CommClosedError, TimeoutError) as error:
            raise InputError(
                f"the scheduler at {address} was lost. What is done is kept, and the same command goes on from there."
            ) from error
        except ImportError as error:
            raise InputError(
                f"a worker of the cluster at {address} cannot load sonarmap as it is here ({error}). Install the same "
                "version there, with what the method wants."
            ) from error
        finally:
            client.close(timeout=1)


def _connected(connect: Callable[..., Any], address: str) -> Any:
    """A client of the scheduler, once it has a worker."""
    from distributed.comm.addressing import get_address_host_port

    try:
        # looked for first, as a client that finds nobody leaves threads behind
        create_connection(get_address_host_port(address), _PATIENCE).close()
        client = connect(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address!r} ({error}). Give the address that 'dask scheduler' prints, as in "
            "--scheduler tcp://10.0.0.5:8786."
        ) from error
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except (OSError, ValueError) as error:  # its TimeoutError is an OSError
        client.close(timeout=1)
        raise InputError(
            f"the Dask scheduler at {address} has no workers. Start some, as with 'dask worker {address} --nthreads 1'."
        ) from error
    return client


def _divided(jobs: int, workers: int, together: int) -> deque[range]:
    """The jobs in pieces of neighbors, small enough for every worker to get some."""
    size = min(together, max(1, jobs // (_WAITING * max(1, workers))))
    return deque(range(start, min(start + size, jobs)) for start in range(0, jobs, size))


class _Here(Executor):
    """Does a job where it is submitted; what it raises comes at once."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future
