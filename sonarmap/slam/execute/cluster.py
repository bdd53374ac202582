"""The workers of a Dask cluster, and how scans come to them."""

import asyncio
import logging
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from concurrent.futures import Executor as Pool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from socket import create_connection
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.executor import PATIENCE, Executor
from sonarmap.slam.execute.transport import ScanKey
from sonarmap.spectral.scan import Scan

# So much of the scans stays on the workers together [bytes], as 1,700 scans of 25,000 points have. What is needed again
# after that is sent again.
_MOST_HELD = 2**29
# Loggers that print tracebacks where workers or the scheduler are lost.
_NOISY_LOGGERS = (
    *(f"distributed{part}" for part in ("", ".client", ".core", ".comm", ".utils")),
    "tornado.application",
)


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """The workers of a Dask cluster, for as long as the block lasts.

    Nothing but work, and the scans that it needs, is sent to them: they may have other users.

    Args:
        address: of the scheduler, as in "tcp://10.0.0.5:8786", or "tls://10.0.0.5:8786" with the certificates that
            Dask's configuration names.

    Raises:
        InputError: Dask is not installed, the scheduler cannot be reached, has no workers, or was lost; sonarmap is not
            installed on a worker.
    """
    try:
        from dask import config
        from distributed import Client
    except ImportError as error:
        raise InputError("`scheduler` needs Dask: pip install 'sonarmap[cluster]'") from error
    for name in _NOISY_LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is raised, too
    large = "distributed.admin.large-graph-warning-threshold"  # a portion of a map has its scans with it
    with config.set({"distributed.comm.timeouts.connect": PATIENCE, large: "1 GiB"}):
        client = _connected(Client, address)
        try:
            with _explained_errors(client, address):
                yield Executor(_DaskPool(client), _Scattered(client), partial(_worker_count, client))
        finally:
            client.close(timeout=1)


@contextmanager
def _explained_errors(client: Any, address: str) -> Iterator[None]:
    """Dask's errors as InputErrors that say what to do."""
    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    kept = "What is done is kept, and the same command continues from there."
    try:
        yield
    except (KilledWorker, CancelledError, CommClosedError, TimeoutError) as error:
        # work is canceled where the worker that held its scans has ended, and where the scheduler has
        if isinstance(error, KilledWorker) or (isinstance(error, CancelledError) and client.status == "running"):
            raise InputError(
                f"workers of the cluster at {address} ended again and again, as happens where memory is short; give "
                f"them more, or use a smaller `edge`. {kept}"
            ) from error
        raise InputError(f"the scheduler at {address} was lost. {kept}") from error
    except ImportError as error:
        raise InputError(
            f"a worker of the cluster at {address} cannot load the sonarmap of this machine ({error}). Install the "
            "same version there, with the packages that the method needs."
        ) from error


def _connected(connect: Callable[..., Any], address: str) -> Any:
    """A client of the scheduler, once it has a worker."""
    from distributed.comm.addressing import get_address_host_port

    try:
        # Tried first, as Dask tries for PATIENCE; a port with TLS takes the connection, too.
        create_connection(get_address_host_port(address), PATIENCE).close()
    except (OSError, ValueError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address!r} ({error}). Give the address that 'dask scheduler' prints, as in "
            "`scheduler=tcp://10.0.0.5:8786`."
        ) from error
    try:
        with ThreadPoolExecutor(1) as thread:  # this one may have an event loop of its own
            thread.submit(lambda: asyncio.run(_greet(address))).result()
        client = connect(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:  # as Dask says that certificates are missing
        raise InputError(
            f"what listens at {address!r} takes no connection ({_cause(error)}). A scheduler that was started with "
            "certificates wants `scheduler=tls://HOST:PORT`, and Dask's settings distributed.comm.tls on this machine, "
            "too; one that was not wants tcp://."
        ) from error
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except (OSError, ValueError) as error:  # its TimeoutError is an OSError
        client.close(timeout=1)
        raise InputError(
            f"the Dask scheduler at {address} has no workers. Start some, as with 'dask worker {address} --nthreads 1'."
        ) from error
    return client


async def _greet(address: str) -> None:
    """Connect once, with the certificates; a client that cannot leaves threads behind, which print tracebacks."""
    from distributed.comm.core import connect
    from distributed.security import Security

    comm = await connect(address, timeout=PATIENCE, **Security().get_connection_args("client"))
    await comm.close()


def _cause(error: BaseException) -> str:
    """What an error says that was raised because of another: of the first of them."""
    while error.__cause__ is not None:
        error = error.__cause__
    return " ".join(str(error).split()) or type(error).__name__


def _worker_count(client: Any) -> int:
    try:
        return len(client.nthreads())
    except OSError as error:  # a plain one could be of anybody's files
        raise TimeoutError(str(error)) from error


class _DaskPool(Pool):
    """Work as Dask's futures. Work that is lost is canceled, and can be submitted again.

    Dask's own pool never ends what is finished on a worker that ends before its result is fetched, and a scan with it.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        # not pure: a key made from the arguments would be shared with another run that asks for the same
        submitted = self._client.submit(fn, *args, **kwargs, pure=False)
        submitted.add_done_callback(partial(_settle, future))
        return future


def _settle(future: Future[Any], submitted: Any) -> None:
    """Give a future what Dask's, which is done, has."""
    try:
        result = submitted.result(timeout=PATIENCE)
    except (CancelledError, asyncio.CancelledError, TimeoutError):
        future.cancel()
        future.set_running_or_notify_cancel()
    except BaseException as error:  # noqa: BLE001 - whoever waits for the future raises it
        future.set_exception(error)
    else:
        future.set_result(result)


class _Scattered:
    """Every scan is sent to one worker, from where Dask brings it to those that need it: not through the scheduler."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._held: dict[ScanKey, tuple[Any, int]] = {}  # futures and their bytes; the one used last comes last
        self._direct = True

    def source(self, scan: ScanKey, load: Callable[[], Scan]) -> Any:
        future, size = self._held.pop(scan, (None, 0))
        if future is None or future.status != "finished":  # what a lost worker held alone is lost
            loaded = _HeldScan(load())
            future, size = self._send(loaded), loaded.size
        self._held[scan] = future, size
        while sum(size for _, size in self._held.values()) > _MOST_HELD and len(self._held) > 1:
            del self._held[next(iter(self._held))]  # the scheduler keeps it for pieces of work that are under way
        return future

    def _send(self, scan: "_HeldScan") -> Any:
        if self._direct:
            try:
                return self._client.scatter(scan, direct=True, hash=False)
            except OSError:  # this machine cannot reach the workers, or one has just ended
                self._direct = False
        try:
            return self._client.scatter(scan, direct=False, hash=False)
        except OSError as error:
            raise InputError(
                f"no worker of the cluster can be sent a scan ({error}). Start some; what is done is kept, and the "
                "same command continues from there."
            ) from error


@dataclass(frozen=True, slots=True)
class _HeldScan:
    """A scan in the memory of a worker."""

    scan: Scan

    @property
    def size(self) -> int:
        arrays = self.scan.points, self.scan.strength, self.scan.viewpoints, self.scan.times
        return sum(array.nbytes for array in arrays if array is not None)

    def __sizeof__(self) -> int:
        return self.size  # Dask asks, to know how full a worker is

    def load(self) -> Scan:
        return self.scan
