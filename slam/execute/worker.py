"""The side that registers: one registrar and the scans that it prepared last, in this process or in another."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from threading import Lock
from time import perf_counter
from typing import Protocol

import numpy as np
from threadpoolctl import ThreadpoolController

from kernels.errors import InputError
from slam.execute.attempt import Attempt, to_text
from slam.execute.scan_key import KeyedScan
from spectral.result import Registrar


@dataclass(frozen=True, slots=True)
class Done:
    """A pair that was registered.

    Attributes:
        attempt: what came of it, as `slam.execute.attempt.to_text` tells it.
        seconds: how long it took, with the preparing of scans [s].
    """

    attempt: str
    seconds: float


@dataclass(frozen=True, slots=True)
class Signed:
    """A scan whose signature was asked for.

    Attributes:
        signature: (K,) float32; None where the scan cannot be prepared.
        seconds: how long it took [s].
    """

    signature: np.ndarray | None
    seconds: float


class Hands(Protocol):
    """What does the work."""

    def register(self, pairs: Sequence[tuple[KeyedScan, KeyedScan]]) -> list[Done]:
        """Register the second scan to the first of every pair."""
        ...

    def sign(self, scans: Sequence[KeyedScan]) -> list[Signed]:
        """The signature of every scan."""
        ...

    def forget(self) -> None:
        """Free what is held in this process."""
        ...


class Worker:
    """A registrar at work.

    Prepared scans hold device memory: the `prepared` used last are kept, and one more while the next is prepared.
    BLAS works in one thread meanwhile: how it sums depends on the number of its threads, and on arrays as small as a
    pair's several are slower.

    Args:
        registrar: the method.
        prepared: how many prepared scans to keep, at least 2.
    """

    def __init__(self, registrar: Registrar, prepared: int) -> None:
        self._registrar = registrar
        self._prepare = lru_cache(maxsize=prepared)(lambda one: registrar.prepare(one.scan))
        self._threads = ThreadpoolController()

    def forget(self) -> None:
        """Free the prepared scans."""
        self._prepare.cache_clear()

    def register(self, pairs: Sequence[tuple[KeyedScan, KeyedScan]]) -> list[Done]:
        """Register the second scan to the first of every pair. A pair that fails is told, not raised.

        Raises:
            DeviceError: the machine failed, not the pair.
        """
        with self._threads.limit(limits=1, user_api="blas"):
            return [self._register(target, source) for target, source in pairs]

    def sign(self, scans: Sequence[KeyedScan]) -> list[Signed]:
        """The signature of every scan; None for one that cannot be prepared.

        Raises:
            DeviceError: the machine failed, not the scan.
        """
        with self._threads.limit(limits=1, user_api="blas"):
            return [self._sign(scan) for scan in scans]

    def _register(self, target: KeyedScan, source: KeyedScan) -> Done:
        start = perf_counter()
        try:
            attempt = Attempt(self._registrar.register(self._prepare(target), self._prepare(source)))
        except InputError as error:
            attempt = Attempt(None, str(error))
        return Done(to_text(attempt), perf_counter() - start)

    def _sign(self, scan: KeyedScan) -> Signed:
        start = perf_counter()
        signature = None
        with suppress(InputError):  # its pairs will tell why
            signature = self._registrar.signature(self._prepare(scan))  # pyright: ignore[reportAttributeAccessIssue]
        return Signed(signature, perf_counter() - start)


@dataclass(frozen=True, slots=True)
class Recipe:
    """What a process makes its worker from, once. It travels with every piece of work, so its parts are small.

    Attributes:
        make: the registrar; a function of a module, or a partial of one.
        key: of the method: the same for two recipes that make the same.
        prepared: how many prepared scans to keep, at least 2.
    """

    make: Callable[[], Registrar]
    key: str
    prepared: int

    def register(self, pairs: Sequence[tuple[KeyedScan, KeyedScan]]) -> list[Done]:
        """As `Worker.register`, by this process's worker."""
        with _lock:
            return _worker(self).register(pairs)

    def sign(self, scans: Sequence[KeyedScan]) -> list[Signed]:
        """As `Worker.sign`, by this process's worker."""
        with _lock:
            return _worker(self).sign(scans)

    def forget(self) -> None:
        """Nothing is held in the process that only tells others."""


# Of this process: a Dask worker may have several threads, but a registrar serves one pair at a time.
_lock = Lock()
_made: dict[tuple[str, int], Worker] = {}


def _worker(recipe: Recipe) -> Worker:
    key = (recipe.key, recipe.prepared)
    if key not in _made:
        _made.clear()  # the device's memory is for one
        _made[key] = Worker(recipe.make(), recipe.prepared)
    return _made[key]


def release() -> None:
    """Free this process's worker, and its device's memory."""
    with _lock:
        _made.clear()
