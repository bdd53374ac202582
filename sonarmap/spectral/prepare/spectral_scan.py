"""A scan prepared for the spectral registration, and the signature that scans are compared by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.device.device import Array
from sonarmap.spectral.prepare.prepared import Prepared
from sonarmap.spectral.prepare.range_image import View
from sonarmap.spectral.prepare.surface import Surface
from sonarmap.spectral.scan import PosePrior

# Every second of the innermost layers: farther out the spectrum knows how a surface lies in the voxels, which a
# rotation changes, and neighbors say much the same.
_LAYERS = slice(0, 12, 2)


def signature(products: np.ndarray) -> np.ndarray:
    """What layers have in common with each other and with themselves, degree by degree: (K,) float32 in -1..1.

    With e[l, r] the energy of degree l as a share of its layer's, as the magnitude of a layer depends on how much was
    seen rather than on what, and c[l, r, s] the correlation of the orders of two layers, -1..1:

        signature[l, r, s] = c[l, r, s] (e[l, r] e[l, s])^(1/4), r <= s.

    Where r = s these are the roots of the shares, between which the distance is Hellinger's: fine degrees, which are
    weak, count in it too. Products are (degrees, L, L), from `Harmonics.products`; degree 0, a layer's mean, is left
    out. K is (degrees - 1) n (n + 1) / 2 with n = 6 layers, or half of L where L is below 12.
    """
    chosen = products[1:, _LAYERS, _LAYERS].astype(np.float64)
    energies = np.diagonal(chosen, axis1=1, axis2=2)
    faintest = np.finfo(np.float64).tiny
    shares = energies / np.maximum(energies.sum(axis=0), faintest)
    scales = shares**0.25 / np.sqrt(np.maximum(energies, faintest))
    first, second = np.triu_indices(chosen.shape[1])
    return (chosen * scales[:, :, None] * scales[:, None])[:, first, second].astype(np.float32).ravel()


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
