"""A benchmark case: a kernel and its twin, the bytes that the kernel moves, and the tolerance of their difference.

The bytes are those that the algorithm must move: the valid elements of each input and output array, once. A transform
in three dimensions passes over its array twice, along rows and columns and along the first axis, as no cache holds it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sonarmap.kernels.pomf.peak import Peak

# Largest relative L2 differences from a twin in single precision
FFT = 1e-6
ELEMENTWISE = 1e-6
WHITENED = 1e-5
RESAMPLED = 5e-5
BLUR = 0.7  # standard deviation of the blur in the correlation over translations [voxels]


@dataclass(frozen=True, slots=True)
class Peer:
    """Another library that does the same work."""

    name: str  # of the library
    run: Callable[[], object]  # do the work and wait for its end
    restore: Callable[[], object] = lambda: None  # restore input that `run` overwrites


@dataclass(frozen=True, slots=True)
class KernelCase:
    """A kernel on one input, and the same work by NumPy and SciPy."""

    name: str  # of the kernel in its module
    twin_name: str  # functions that the twin uses
    moved: int  # bytes that the algorithm must move
    tolerance: float  # largest relative L2 difference of the results
    run: Callable[[], Any]  # queue the kernel's work without waiting for it, and return its result
    twin: Callable[[], np.ndarray]  # do the same on the host, and return the result
    read: Callable[[Any], np.ndarray] = lambda result: result.get()  # bring the result of `run` into the twin's form
    restore: Callable[[], object] = lambda: None  # restore input that `run` and `twin` overwrite
    peers: Callable[[], list[Peer]] = list  # create the peers


def peak_numbers(peak: Peak) -> np.ndarray:
    """The peak in the form of `twins.peak`."""
    return np.concatenate([peak.index, [peak.value, (peak.value - peak.mean) / peak.std], peak.neighborhood.ravel()])


def valid(spectrum: Any) -> np.ndarray:
    """A half spectrum of cubes or squares from the device, without its padding."""
    return spectrum.get()[..., : spectrum.shape[-2] // 2 + 1]
