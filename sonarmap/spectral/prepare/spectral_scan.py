"""A scan prepared for the spectral registration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.device.device import Array
from sonarmap.spectral.prepare.prepared import Prepared
from sonarmap.spectral.prepare.range_image import View
from sonarmap.spectral.prepare.surface import Surface
from sonarmap.spectral.scan import PosePrior

# The exponents that the coarse volumes are whitened with: 1, phase only, weighs all frequencies alike; 0.5 leaves more
# to those that hold much of the scan, which noise, distortion and an uncertain rotation disturb least.
WHITENINGS = (1.0, 0.5)


@dataclass(frozen=True, slots=True)
class CoarseVolume:
    """A scan on the coarse grid of `coarse_edge` voxels an edge, its spectrum whitened with each of WHITENINGS."""

    points: Array
    spectra: tuple[Array, ...]


@dataclass(frozen=True, slots=True)
class SpectralScan:
    """What one scan contributes to every pair; its arrays are on the device that prepared it."""

    volume: Prepared  # voxels and spectra on the whole grid
    coarse: CoarseVolume  # the same on the coarse grid
    coefficients: Array  # device (degrees, layers, orders) complex64 of its layers, from `So3.equalize`
    signature: np.ndarray  # (K,) float32, nearly the same however the scan is turned and moved, from `signature`
    surface: Surface  # points and normals, for the refinement
    smoother: Callable[[], Sequence[Surface]]  # the same smoothed further, the smoothest first, when it is asked for
    view: View  # what the sensor saw
    prior: PosePrior | None  # what other instruments say about its pose, or None
    # the same on the grid of `second_edge`, prepared when it is asked for; None where there is none, or where the scan
    # shows too little on it
    second: Callable[[], SpectralScan | None]
