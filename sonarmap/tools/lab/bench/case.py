"""One kernel beside its twin: what each runs, what it moves, how close they must come.

Bytes are those that the algorithm must move: valid elements of each array that goes in or comes out once. A transform
in three dimensions that no cache holds goes over its array twice: along rows and columns, and along the first axis.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sonarmap.kernels.pomf.peak import Peak

# Largest relative L2 difference from a twin in single precision
FFT = 1e-6
ELEMENTWISE = 1e-6
WHITENED = 1e-5
RESAMPLED = 5e-5
BLUR = 0.7  # of the correlation that the translation is read from [voxels]


@dataclass(frozen=True, slots=True)
class Peer:
    """Another library that does the same work."""

    name: str  # the library's
    run: Callable[[], object]  # the work, done when it returns
    restore: Callable[[], object] = lambda: None  # put back what it overwrites of its input


@dataclass(frozen=True, slots=True)
class KernelCase:
    """One kernel on one input, and the same by NumPy and SciPy."""

    name: str  # the kernel's, as its module calls it
    twin_name: str  # what the twin is made of
    moved: int  # bytes that the algorithm must move
    tolerance: float  # largest relative L2 difference of the results
    run: Callable[[], Any]  # queue the kernel's work, which the caller waits for, and return its result
    twin: Callable[[], np.ndarray]  # do the same on the host, and return the result
    read: Callable[[Any], np.ndarray] = lambda result: result.get()  # what `run` returned, as the twin gives it
    restore: Callable[[], object] = lambda: None  # put back what run and twin overwrite of their input
    peers: Callable[[], list[Peer]] = list  # other libraries, made when they are asked for


def peak_numbers(peak: Peak) -> np.ndarray:
    """As `twins.peak` has them."""
    return np.concatenate([peak.index, [peak.value, (peak.value - peak.mean) / peak.std], peak.neighborhood.ravel()])


def valid(spectrum: Any) -> np.ndarray:
    """A half spectrum of cubes or squares from the device, without its padding."""
    return spectrum.get()[..., : spectrum.shape[-2] // 2 + 1]
