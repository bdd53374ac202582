"""Workers, which register pairs by a registrar with its latest prepared scans, in this or in another process."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Protocol

from threadpoolctl import ThreadpoolController

from sonarmap.kernels.device.arrays import free_recycled
from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.job import Job, KeyedScan, PairJob
from sonarmap.slam.execute.pair_text import signature_to_text, to_text
from sonarmap.slam.pair import DEFECT
from sonarmap.spectral.memory import scans_that_fit
from sonarmap.spectral.result import Registrar

_WITHOUT_DEVICE = 16  # prepared scans to keep of a method whose memory is unknown
_MAX_PREPARED = 256  # larger surveys gain little by more
_MEMORY_DIVISOR = 3  # the device's memory, over the part that prepared scans may take
# The scans used last are kept for the next pairs. Of the others, the one used last is dropped first: each round of a
# survey goes through all scans in order, so that those used longest ago are needed soonest.
_RECENT = 4


def prepared_limit(registrar: Registrar, workers: int = 1) -> int:
    """Number of prepared scans to keep between pairs and rounds: as many as fit a part of the memory that `workers`
    share, up to a limit.

    The memory of a scan follows from the registrar's `device` and `grid`, if it has them.
    """
    device, grid = getattr(registrar, "device", None), getattr(registrar, "grid", None)
    if device is None or grid is None:
        return _WITHOUT_DEVICE
    return max(2, min(_MAX_PREPARED, scans_that_fit(device, grid.edge) // (_MEMORY_DIVISOR * workers)))


@dataclass(frozen=True, slots=True)
class TimedText:
    """The result of registering a pair, or a scan's signature, as text (`slam.execute.pair_text`)."""

    content: str  # the result
    seconds: float  # duration, with the preparation of scans [s]


class PairWorker(Protocol):
    """The task that an executor runs to register pairs."""

    def run(self, jobs: Sequence[Job]) -> list[TimedText]:
        """The result of every job, in their order."""
        ...

    def release(self) -> None: ...


class Worker:
    """A registrar with scans that it has prepared.

    Prepared scans hold device memory: `prepared` of them are kept, and one more while the next is prepared.
    BLAS runs in one thread: its rounding depends on the number of threads, and several are slower on arrays as small as
    a pair's.

    Args:
        prepared: number of prepared scans to keep, at least 2.
    """

    def __init__(self, registrar: Registrar, prepared: int) -> None:
        self._registrar, self._most = registrar, prepared
        self._prepared: dict[tuple[str, str], Any] = {}  # by `KeyedScan.key`, in the order of their last use
        self._threads = ThreadpoolController()

    def release(self) -> None:
        """Free the prepared scans, and the device memory that is kept for reuse."""
        self._prepared.clear()
        free_recycled()

    def run(self, jobs: Sequence[Job]) -> list[TimedText]:
        """The result of every job. A failed pair's text says why; a scan that cannot be prepared has no signature.

        Raises:
            DeviceError: the machine failed, not the scans.
        """
        with self._threads.limit(limits=1, user_api="blas"):
            return [self._timed(job) for job in jobs]

    def _timed(self, job: Job) -> TimedText:
        start = perf_counter()
        content = self._signature(job) if isinstance(job, KeyedScan) else self._register(job)
        return TimedText(content, perf_counter() - start)

    def _prepare(self, scan: KeyedScan) -> Any:
        prepared = self._prepared.pop(scan.key, None)
        if prepared is None:
            prepared = self._registrar.prepare(scan.scan)
        self._prepared[scan.key] = prepared
        if len(self._prepared) > self._most:
            del self._prepared[list(self._prepared)[max(0, self._most - _RECENT)]]
        return prepared

    def _register(self, pair: PairJob) -> str:
        blame = ""
        try:
            scans = self._prepare(pair.target), self._prepare(pair.source)
            blame = DEFECT
            if pair.expected is None:
                registration = self._registrar.register(*scans)
            else:
                # pyrefly: ignore[missing-attribute]
                registration = self._registrar.register_expected(*scans, pair.expected)
        except InputError as error:
            return to_text(None, f"{blame}{error}")
        return to_text(registration.by_scans)  # the graph holds the instruments' measurements itself

    def _signature(self, scan: KeyedScan) -> str:
        signature = None
        with suppress(InputError):  # the failures of its pairs say why
            # pyrefly: ignore[missing-attribute]
            signature = self._registrar.signature(self._prepare(scan))
        return signature_to_text(signature)


@dataclass(frozen=True, slots=True)
class WorkerSpec:
    """The specification of another process's worker. It is sent with every piece of work, so its parts are small."""

    make: Callable[[], Registrar]  # makes the registrar; a function of a module, or a partial of one
    key: str  # of the method: equal for specifications that make equal registrars
    prepared: int  # number of prepared scans to keep, at least 2

    def run(self, jobs: Sequence[Job]) -> list[TimedText]:
        """`Worker.run` of the calling process's worker, which is made on the first call and kept until the end."""
        if self.key not in _workers:
            _workers.clear()  # the device's memory suffices for one
            _workers[self.key] = Worker(self.make(), self.prepared)
        return _workers[self.key].run(jobs)

    def release(self) -> None:
        """Nothing to free: the process that hands out the work has no worker."""


_workers: dict[str, Worker] = {}  # the worker of this process, by the key of its specification
