"""A scan prepared for the spectral registration, and its signature for place recognition."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.device.device import Array
from sonarmap.spectral.prepare.prepared import Prepared
from sonarmap.spectral.prepare.range_image import View
from sonarmap.spectral.prepare.surface import Surface
from sonarmap.spectral.scan import PosePrior

# Every second of the innermost layers, as neighbors are nearly equal: the outer layers depend on the surface's position
# in its voxels, which a rotation changes.
_LAYERS = slice(0, 12, 2)


def signature(products: np.ndarray) -> np.ndarray:
    """Rotation-invariant signature of a scan, (K,) float32 in -1..1: products of its layers, degree by degree.

    With e[l, r] the energy of degree l as a share of its layer's, since a layer's magnitude depends on the extent of
    the view, and c[l, r, s] the correlation over the orders of two layers, -1..1:

        signature[l, r, s] = c[l, r, s] (e[l, r] e[l, s])^(1/4), r <= s.

    For r = s these are the roots of the shares, so that distances are Hellinger's, in which the weak fine degrees count
    too. Products are (degrees, L, L), from `Harmonics.products`; degree 0, a layer's mean, is left out. K is
    (degrees - 1) n (n + 1) / 2 with n = 6 layers, or half of L if L is below 12.
    """
    chosen = products[1:, _LAYERS, _LAYERS].astype(np.float64)
    energies = np.diagonal(chosen, axis1=1, axis2=2)
    faintest = np.finfo(np.float64).tiny
    shares = energies / np.maximum(energies.sum(axis=0), faintest)
    scales = shares**0.25 / np.sqrt(np.maximum(energies, faintest))
    first, second = np.triu_indices(chosen.shape[1])
    return (chosen * scales[:, :, None] * scales[:, None])[:, first, second].astype(np.float32).ravel()


# Exponents of the whitening of coarse volumes: 1, phase only, weights all frequencies equally; 0.5 favors those with
# much energy, which are robust to noise, distortion and errors of the rotation.
WHITENINGS = (1.0, 0.5)


@dataclass(frozen=True, slots=True)
class CoarseVolume:
    """A scan on the coarse grid, `coarse_edge` voxels per edge, with a spectrum whitened by each of WHITENINGS."""

    points: Array
    spectra: tuple[Array, ...]


@dataclass(frozen=True, slots=True)
class SpectralScan:
    """What a scan contributes to all its pairs; its arrays are on the device that prepared it."""

    volume: Prepared  # voxels and spectra on the whole grid
    coarse: CoarseVolume  # points and spectra on the coarse grid
    coefficients: Array  # device (degrees, layers, orders) complex64 of its layers, from `So3.equalize`
    signature: np.ndarray  # (K,) float32 from `signature`, nearly invariant to rotations and shifts
    surface: Surface  # points and normals for the refinement
    smoother: Callable[[], Sequence[Surface]]  # smoothed surfaces, the smoothest first, computed on demand
    view: View  # range images of the sensor
    prior: PosePrior | None  # its pose as measured by other instruments, or None
    # the scan on the grid of `second_edge`, prepared on demand; None without such a grid, or if the scan shows too
    # little structure on it
    second: Callable[[], SpectralScan | None]
