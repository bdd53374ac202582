"""What registers pairs: one registrar and the scans that it prepared last."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Protocol

from threadpoolctl import ThreadpoolController

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.pair_text import signature_to_text, to_text
from sonarmap.slam.execute.scan_key import ScanKey
from sonarmap.slam.execute.transport import ScanSource
from sonarmap.slam.pair import DEFECT
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.memory import prepared_size, scans_that_fit
from sonarmap.spectral.result import Registrar

Sources = Mapping[ScanKey, ScanSource]

# Chains need so many prepared scans, and loops come back to more: as many as an eighth of the memory holds are kept, up
# to those of the last few tracks. The rest of the memory is the map's, and the other programs'.
_CHAIN, _TRACKS = 8, 128
_SHARE = 8


def prepared_limit(registrar: Registrar, workers: int = 1) -> int:
    """How many prepared scans to keep: as many as are useful and fit, with one more while the next is prepared.

    Args:
        registrar: its `device` and `grid`, where it has them, say how much memory a prepared scan takes.
        workers: that share the memory.
    """
    device, grid = getattr(registrar, "device", None), getattr(registrar, "grid", None)
    if device is None or grid is None:
        return _CHAIN
    fitting = max(2, scans_that_fit(device, grid.edge) - 1)
    useful = device.memory // (_SHARE * workers * prepared_size(grid.edge))
    return min(fitting, max(_CHAIN, min(_TRACKS, useful)))


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

    target: ScanKey
    source: ScanKey
    expected: ExpectedPose | None = None


class PairWorker(Protocol):
    """What an executor runs to register pairs."""

    def register(self, pairs: Sequence[PairJob], sources: Sources) -> list[TimedText]:
        """Register every pair, of scans that `sources` give."""
        ...

    def signatures(self, scans: Sequence[ScanKey], sources: Sources) -> list[TimedText]:
        """The signature of every scan, which `sources` give."""
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
        self._registrar, self._most = registrar, prepared
        self._prepared: dict[ScanKey, Any] = {}  # the one used last comes last
        self._threads = ThreadpoolController()

    def release(self) -> None:
        """Free the prepared scans."""
        self._prepared.clear()

    def register(self, pairs: Sequence[PairJob], sources: Sources) -> list[TimedText]:
        """Register every pair. Where one fails, its text says why.

        Raises:
            DeviceError: the machine failed, not the pair.
        """
        with self._threads.limit(limits=1, user_api="blas"):
            return [self._register(pair, sources) for pair in pairs]

    def signatures(self, scans: Sequence[ScanKey], sources: Sources) -> list[TimedText]:
        """The signature of every scan; none for a scan that cannot be prepared.

        Raises:
            DeviceError: the machine failed, not the scan.
        """
        with self._threads.limit(limits=1, user_api="blas"):
            return [self._signature(scan, sources) for scan in scans]

    def _prepare(self, scan: ScanKey, sources: Sources) -> Any:
        prepared = self._prepared.pop(scan, None)
        if prepared is None:
            prepared = self._registrar.prepare(sources[scan].load())
        self._prepared[scan] = prepared
        if len(self._prepared) > self._most:
            del self._prepared[next(iter(self._prepared))]
        return prepared

    def _register(self, pair: PairJob, sources: Sources) -> TimedText:
        start, blame = perf_counter(), ""
        try:
            scans = self._prepare(pair.target, sources), self._prepare(pair.source, sources)
            blame = DEFECT
            if pair.expected is None:
                registration = self._registrar.register(*scans)
            else:
                registration = self._registrar.register_expected(*scans, pair.expected)  # pyright: ignore[reportAttributeAccessIssue]
            # the graph holds the instruments' measurements itself
            content = to_text(registration.by_scans)
        except InputError as error:
            content = to_text(None, f"{blame}{error}")
        return TimedText(content, perf_counter() - start)

    def _signature(self, scan: ScanKey, sources: Sources) -> TimedText:
        start = perf_counter()
        signature = None
        with suppress(InputError):  # its pairs will tell why
            signature = self._registrar.signature(self._prepare(scan, sources))  # pyright: ignore[reportAttributeAccessIssue]
        return TimedText(signature_to_text(signature), perf_counter() - start)
