"""One kernel beside its twin: what each runs, what it moves, how close they must come.

Bytes are those that the algorithm must move: each array that goes in or comes out once, valid elements only. A
three-dimensional transform that no cache holds must go over its array twice: once along rows and columns, plane by
plane, from the volume to the spectrum or back, and once along the first axis, in place.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sonarmap.kernels.pomf.peak_fit import Peak
from sonarmap.tools.lab.bench.rates import Traffic
from sonarmap.tools.lab.bench.workload import Workload

# Relative L2 difference to a twin that rounds as coarsely itself.
FFT, ELEMENTWISE, WHITENED, RESAMPLED = 1e-6, 1e-6, 1e-5, 5e-5
# Of the correlation that the translation is read from [voxels].
BLUR = 0.7


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
    traffic: Traffic  # what the algorithm must move
    tolerance: float  # largest relative L2 difference of the results
    run: Callable[[], Any]  # queue the kernel's work, which the caller waits for, and return its result
    twin: Callable[[], np.ndarray]  # do the same on the host, and return the result
    read: Callable[[Any], np.ndarray] = lambda result: result.get()  # what `run` returned, as the twin gives it
    restore: Callable[[], object] = lambda: None  # put back what run and twin overwrite of their input
    # additions and multiplications of the algorithm; of a transform 5 n log2 n for n complex points, and half for n
    # real ones. 0 where they do not matter.
    flops: float = 0.0
    # what single launches move, by their kernel's name
    passes: Mapping[str, Traffic] = field(default_factory=dict[str, Traffic])
    peers: Callable[[], list[Peer]] = list  # other libraries, made when they are asked for


def peak_numbers(peak: Peak) -> np.ndarray:
    """As `twins.peak` has them."""
    return np.concatenate([peak.index, [peak.value, (peak.value - peak.mean) / peak.std], peak.neighborhood.ravel()])


def transform_passes(w: Workload) -> dict[str, Traffic]:
    """The launches that a transform may be made of: planes and sheets on a processor, axes on a graphics processor."""
    outer, inner = Traffic(reads=w.volume_bytes, writes=w.half_bytes), Traffic(in_place=2 * w.half_bytes)
    return {"planes": outer, "rows": outer, "sheets": inner, "columns_1": inner, "columns_0": inner}


def valid(spectrum: Any) -> np.ndarray:
    """A half spectrum of cubes or squares from the device, without its padding."""
    return spectrum.get()[..., : spectrum.shape[-2] // 2 + 1]
