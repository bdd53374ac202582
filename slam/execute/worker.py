"""What registers pairs: one registrar and the scans that it prepared last, in this process or in another."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from threading import Lock
from time import perf_counter
from typing import Protocol

from threadpoolctl import ThreadpoolController

from kernels.errors import InputError
from slam.execute.pair_text import signature_to_text, to_text
from slam.execute.scan_key import KeyedScan
from spectral.expected import ExpectedPose
from spectral.memory import scans_that_fit
from spectral.result import Registrar

MOST_PREPARED = 8  # loops seldom come back to a scan that was used longer ago


def prepared_limit(registrar: Registrar) -> int:
    """How many prepared scans to keep: as many as are useful and fit, with one more while the next is prepared.

    Args:
        registrar: its `device` and `grid`, where it has them, say how much memory a prepared scan takes.
    """
    device, grid = getattr(registrar, "device", None), getattr(registrar, "grid", None)
    fitting = scans_that_fit(device, grid.edge) - 1 if device and grid else MOST_PREPARED
    return min(MOST_PREPARED, max(2, fitting))


@dataclass(frozen=True, slots=True)
class TimedText:
    """The result of registering a pair, or a scan's signature, as text (`slam.execute.pair_text`).

    Attributes:
        content: the result.
        seconds: how long it took, with the preparing of scans [s].
    """

    content: str
    seconds: float


@dataclass(frozen=True, slots=True)
class PairJob:
    """Two scans to register, source to target, and where the motion expects them to lie; None where nothing does."""

    target: KeyedScan
    source: KeyedScan
    expected: ExpectedPose | None = None


class PairWorker(Protocol):
    """What an executor runs to register pairs."""

    def register(self, pairs: Sequence[PairJob]) -> list[TimedText]:
        """Register every pair."""
        ...

    def signatures(self, scans: Sequence[KeyedScan]) -> list[TimedText]:
        """The signature of every scan."""
        ...

    def release(self) -> None:
        """Free the memory that this process holds for it."""
        ...


class Worker:
    """A registrar with the scans that it prepared last.

    Prepared scans hold device memory: the `prepared` used last are kept, and one more while the next is prepared.
    BLAS works in one thread meanwhile: how it sums depends on the number of its threads, and on arrays as small as a
    pair's several are slower.

    Args:
        registrar: the method.
        prepared: how many prepared scans to keep, at least 2.
    """

    def __init__(self, registrar: Registrar, prepared: int) -> None:
        self._registrar = registrar
        self._prepare = lru_cache(maxsize=prepared)(lambda keyed: registrar.prepare(keyed.scan))
        self._threads = ThreadpoolController()

    def release(self) -> None:
        """Free the prepared scans."""
        self._prepare.cache_clear()

    def register(self, pairs: Sequence[PairJob]) -> list[TimedText]:
        """Register every pair. Where one fails, its text says why.

        Raises:
            DeviceError: the machine failed, not the pair.
        """
        with self._threads.limit(limits=1, user_api="blas"):
            return [self._register(pair) for pair in pairs]

    def signatures(self, scans: Sequence[KeyedScan]) -> list[TimedText]:
        """The signature of every scan; none for a scan that cannot be prepared.

        Raises:
            DeviceError: the machine failed, not the scan.
        """
        with self._threads.limit(limits=1, user_api="blas"):
            return [self._signature(scan) for scan in scans]

    def _register(self, pair: PairJob) -> TimedText:
        start = perf_counter()
        try:
            scans = self._prepare(pair.target), self._prepare(pair.source)
            if pair.expected is None:
                registration = self._registrar.register(*scans)
            else:
                registration = self._registrar.register_expected(*scans, pair.expected)  # pyright: ignore[reportAttributeAccessIssue]
            # the graph holds the instruments' measurements itself
            content = to_text(registration.by_scans)
        except InputError as error:
            content = to_text(None, str(error))
        return TimedText(content, perf_counter() - start)

    def _signature(self, scan: KeyedScan) -> TimedText:
        start = perf_counter()
        signature = None
        with suppress(InputError):  # its pairs will tell why
            signature = self._registrar.signature(self._prepare(scan))  # pyright: ignore[reportAttributeAccessIssue]
        return TimedText(signature_to_text(signature), perf_counter() - start)


@dataclass(frozen=True, slots=True)
class WorkerSpec:
    """What another process makes its worker from, once. It travels with every piece of work, so its parts are small.

    Attributes:
        make: makes the registrar; a function of a module, or a partial of one.
        key: of the method: the same for two specifications that make the same.
        prepared: how many prepared scans to keep, at least 2.
    """

    make: Callable[[], Registrar]
    key: str
    prepared: int

    def register(self, pairs: Sequence[PairJob]) -> list[TimedText]:
        """As `Worker.register`, by the worker of the process that this is called in."""
        with _lock:
            return _worker_of_process(self).register(pairs)

    def signatures(self, scans: Sequence[KeyedScan]) -> list[TimedText]:
        """As `Worker.signatures`, by the worker of the process that this is called in."""
        with _lock:
            return _worker_of_process(self).signatures(scans)

    def release(self) -> None:
        """Nothing to free: the process that hands out the work has no worker."""


# Of this process: a Dask worker may have several threads, but a registrar serves one pair at a time.
_lock = Lock()
_workers: dict[tuple[str, int], Worker] = {}


def _worker_of_process(spec: WorkerSpec) -> Worker:
    key = (spec.key, spec.prepared)
    if key not in _workers:
        _workers.clear()  # the device's memory is for one
        _workers[key] = Worker(spec.make(), spec.prepared)
    return _workers[key]


def release_worker() -> None:
    """Free this process's worker, and its device's memory."""
    with _lock:
        _workers.clear()
