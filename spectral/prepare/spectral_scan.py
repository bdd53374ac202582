"""A scan prepared for the spectral registration."""

from dataclasses import dataclass

import numpy as np

from kernels.device.device import Array
from spectral.prepare.prepared import Prepared
from spectral.prepare.range_image import RangeImage
from spectral.prepare.surface import Surface
from spectral.scan import PosePrior


@dataclass(frozen=True, slots=True)
class CoarseVolume:
    """A scan on a grid of half as many, twice as large voxels."""

    points: Array
    spectrum: Array


@dataclass(frozen=True, slots=True)
class SpectralScan:
    """What one scan contributes to every pair; its arrays are on the device that prepared it.

    Attributes:
        volume: voxels and spectra on the whole grid.
        coarse: the same on the coarse grid.
        coefficients: (degrees, layers, orders) complex64 of its layers, from `So3.prepare`.
        signature: (K,) float32, nearly the same however the scan is turned and moved, from `signature`.
        surface: points and normals, for the refinement.
        image: what the sensor saw.
        prior: what other instruments say about its pose, or None.
    """

    volume: Prepared
    coarse: CoarseVolume
    coefficients: np.ndarray
    signature: np.ndarray
    surface: Surface
    image: RangeImage
    prior: PosePrior | None
