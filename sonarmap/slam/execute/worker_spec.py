"""What another process makes its worker from, and how long it keeps the worker."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Lock, Timer
from time import monotonic

from sonarmap.slam.execute.scan_key import ScanKey
from sonarmap.slam.execute.worker import PairJob, Sources, TimedText, Worker
from sonarmap.spectral.result import Registrar

# A process without work for so long frees its worker [s]: a cluster's processes stay when a run has ended, however it
# ended, and their devices are for others then. Making the worker again takes about 2 s.
IDLE = 60.0


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

    def register(self, pairs: Sequence[PairJob], sources: Sources) -> list[TimedText]:
        """As `Worker.register`, by the worker of the process that this is called in."""
        with _worker_of_process(self) as worker:
            return worker.register(pairs, sources)

    def signatures(self, scans: Sequence[ScanKey], sources: Sources) -> list[TimedText]:
        """As `Worker.signatures`, by the worker of the process that this is called in."""
        with _worker_of_process(self) as worker:
            return worker.signatures(scans, sources)

    def release(self) -> None:
        """Nothing to free: the process that hands out the work has no worker."""


# Of this process: a Dask worker may have several threads, but a registrar serves one pair at a time.
_lock = Lock()
_workers: dict[tuple[str, int], Worker] = {}
_last_used = 0.0
_idle_timer: Timer | None = None


@contextmanager
def _worker_of_process(spec: WorkerSpec) -> Iterator[Worker]:
    global _last_used, _idle_timer
    key = (spec.key, spec.prepared)
    with _lock:
        if _idle_timer is not None:
            _idle_timer.cancel()
        if key not in _workers:
            _workers.clear()  # the device's memory is for one
            _workers[key] = Worker(spec.make(), spec.prepared)
        try:
            yield _workers[key]
        finally:
            _last_used = monotonic()
            _idle_timer = Timer(IDLE, _release_if_idle)
            _idle_timer.daemon = True
            _idle_timer.start()


def _release_if_idle() -> None:
    """Free this process's worker, and its device's memory, if no work came while this waited for the lock."""
    with _lock:
        if monotonic() - _last_used >= IDLE:
            _workers.clear()
