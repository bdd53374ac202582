"""Magnitude spectra of images on polar coordinates, where a rotation is a shift (Sect. 2.5, Eq. 14)."""

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.groups import lanes
from sonarmap.kernels.device.launch import launch, output, require_array, table
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import row_pitch


def polar_magnitude(
    device: Device,
    spectrum: cla.Array,
    shape: tuple[int, int],
    radii: np.ndarray,
    angles: np.ndarray,
    out: cla.Array | None = None,
) -> cla.Array:
    """Bilinear samples of |F| at (radius cos angle, radius sin angle), axis 0 of the images being x.

    An image I turned by -psi, I_R(v) = I(Rz(psi) v), has |F_R|(k) = |F|(Rz(psi) k): its samples at an angle
    are those of I at the angle + psi. With angles k pi / K, k = 0..K-1, which cover all there is of a real
    image, the samples are cyclic, and a `Pomf` of target I and source I_R peaks at +psi K / pi, for psi
    modulo 180 degrees.

    Args:
        spectrum: (L, H, P) complex64, P = `row_pitch(W)`, of L real images by a batched transform.
        shape: (H, W) of the images, even.
        radii: (M,), from 0 to below half the shorter edge less 1 [frequency bins]; on an image that is not
            square a bin of axis 0 and one of axis 1 are not the same frequency.
        angles: (K,) [rad], from axis 0 towards axis 1; M K is a multiple of 8.

    Returns:
        (L, M, K) float32.
    """
    height, width = shape
    layers, _, pitch = require_array(spectrum, "spectrum", (None, height, row_pitch(width)), np.complex64)
    points = _frequencies(radii, angles, min(shape) // 2)
    result = output(device, out, "out", (layers, len(radii), len(angles)))
    samples = points[0].size
    sizes = np.int32(layers), np.int32(samples), np.int32(height), np.int32(pitch)
    arrays = spectrum, table(device, points), result
    size = (samples // lanes(device), layers)
    launch(device, "resample/polar", "polar_magnitude", size, *arrays, *sizes, group="columns")
    return result


def _frequencies(radii: np.ndarray, angles: np.ndarray, nyquist: int) -> np.ndarray:
    """(2, M, K) float32: where the samples lie along axes 0 and 1 [frequency bins]."""
    radii, angles = np.asarray(radii, np.float64), np.asarray(angles, np.float64)
    if radii.ndim != 1 or not len(radii) or not (radii.min() >= 0 and radii.max() < nyquist - 1):
        raise InputError(f"`radii` are {radii}; wanted a list of numbers from 0 to below {nyquist - 1} bins")
    samples = len(radii) * angles.size
    if angles.ndim != 1 or not samples or samples % 8 or not np.isfinite(angles).all():
        raise InputError(f"{len(radii)} `radii` by {angles.size} `angles`; wanted a multiple of 8 samples in all")
    return np.stack([np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles))]).astype(np.float32)
