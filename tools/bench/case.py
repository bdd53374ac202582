"""One kernel beside its twin: what each runs, what it moves, how close they must come.

Bytes are those that the algorithm must move: each array that goes in or comes out once, valid elements only, no cache
lines that a write fetches; a three-dimensional transform goes over its array once per axis, reading and writing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tools.bench.workload import Workload

# Relative L2 difference to a twin that rounds as coarsely itself.
FFT, ELEMENTWISE, WHITENED, RESAMPLED = 1e-6, 1e-6, 1e-5, 5e-5
# Of the correlation that the translation is read from [voxels].
BLUR = 0.7


@dataclass(frozen=True, slots=True)
class KernelCase:
    """One kernel on one input, and the same by NumPy and SciPy.

    Attributes:
        name: the kernel's, as its module calls it.
        twin_name: what the twin is made of.
        moved: what the algorithm moves [bytes].
        tolerance: largest relative L2 difference of the results.
        run: queue the kernel's work; the caller waits for it.
        read: the result of the last run, as the twin gives it.
        twin: do the same on the host, and return the result.
        restore: put back what run and twin overwrite of their input.
    """

    name: str
    twin_name: str
    moved: int
    tolerance: float
    run: Callable[[], object]
    read: Callable[[], np.ndarray]
    twin: Callable[[], np.ndarray]
    restore: Callable[[], object] = lambda: None


def volume_bytes(w: Workload) -> int:
    """A real volume."""
    return 4 * w.edge**3


def half_bytes(w: Workload) -> int:
    """A half spectrum."""
    return 8 * w.edge**2 * (w.edge // 2 + 1)


def transform_bytes(w: Workload) -> int:
    """A real transform: the rows in one pass from or to the volume, two passes over the half spectrum in place."""
    return volume_bytes(w) + 5 * half_bytes(w)


def valid(spectrum: Any) -> np.ndarray:
    """A half spectrum from the device, without its padding."""
    return spectrum.get()[..., :-7]
