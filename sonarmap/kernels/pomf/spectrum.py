"""Half spectra of real volumes: magnitude, whitening, cross-power.

The arrays are half spectra as `kernels.fft.transform` makes them: complex64 (n0, n1, `row_pitch(n2)`), whose
last axis is valid up to n2/2 (docs/conventions.md).
"""

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import along, lanes, launch, output, require_array, table
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import EDGES, KINDS, row_pitch
from sonarmap.kernels.fft.transform import RealFFT

_WHITEN_AT_ONCE = 8


def magnitude(device: Device, spectrum: cla.Array, edge: int, out: cla.Array | None = None) -> cla.Array:
    """The magnitude of a volume's half spectrum, centered in axes 0 and 1.

    Args:
        spectrum: (edge, edge, P) complex64, P = `row_pitch(edge)`.
        edge: even.

    Returns:
        (edge, edge, edge/2 + 1) float32: index i of axes 0 and 1 is frequency i - edge/2, axis 2 starts at 0.
    """
    _require_edges(edge)
    half, pitch = edge // 2, row_pitch(edge)
    require_array(spectrum, "spectrum", (edge, edge, pitch), np.complex64)
    result = output(device, out, "out", (edge, edge, half + 1))
    sizes = (np.int32(edge), np.int32(edge), np.int32(half), np.int32(pitch))
    size = (along(device, half), edge, edge)
    launch(device, "pomf/spectrum", "magnitude", size, spectrum, result, *sizes, group="planes")
    return result


def whiten(device: Device, spectrum: cla.Array, exponent: float = 1.0, out: cla.Array | None = None) -> cla.Array:
    """F / |F|^exponent, and 0 where |F| is below 1e-9, infinite or not a number.

    Args:
        spectrum: complex64 of any shape whose last axis is a multiple of 8.
        exponent: without a unit. 1 keeps only the phase, for phase-only matched filtering; 0 keeps the spectrum, for
            plain correlation; values between keep a part of the weight of strong frequencies.
        out: the same shape, to write to; may be the spectrum itself.
    """
    if not 0 <= exponent <= 1:
        raise InputError(f"`exponent={exponent}` is out of range; give 0, plain correlation, to 1, phase-only")
    shape = require_array(spectrum, "spectrum", (None,) * spectrum.ndim, np.complex64)
    if shape[-1] % _WHITEN_AT_ONCE:
        raise InputError(
            f"`spectrum` has {shape[-1]} numbers along its last axis; wanted a multiple of 8, as half spectra have"
        )
    result = output(device, out, "out", shape, np.complex64)
    arguments = spectrum, result, np.float32(exponent), np.int32(spectrum.size)
    launch(device, "pomf/spectrum", "whiten", (spectrum.size // lanes(device),), *arguments, group="numbers")
    return result


def cross_power(
    device: Device,
    target: cla.Array,
    source: cla.Array,
    shape: tuple[int, int, int],
    blur: tuple[float, float, float] = (0.0, 0.0, 0.0),
    out: cla.Array | None = None,
) -> cla.Array:
    """target conj(source), blurred: the spectrum of the correlation of two whitened half spectra.

    Args:
        target, source: (n0, n1, `row_pitch(n2)`) complex64, whitened.
        shape: (n0, n1, n2) of the volumes.
        blur: standard deviations, along each axis, of the Gaussian that the correlation is convolved with [voxels]: the
            product is weighted with exp(-2 pi^2 |blur f|^2), f in cycles per voxel. 0 along an axis that counts images.
        out: like target, to write to; may be target or source itself. Its padding is set to 0.
    """
    n0, n1, n2 = shape
    pitch = _require_pair(target, source, shape)
    result = output(device, out, "out", (n0, n1, pitch), np.complex64)
    gains = full_gain(n0, blur[0]), full_gain(n1, blur[1]), half_gain(n2, blur[2])
    gains = [table(device, gain) for gain in gains]
    arguments = target, source, result, *gains, np.int32(n0), np.int32(n1), np.int32(pitch)
    launch(device, "pomf/spectrum", "cross_power", (along(device, pitch), n1, n0), *arguments, group="rows")
    return result


def sum_layers(
    device: Device, target: cla.Array, source: cla.Array, shape: tuple[int, int, int], blur: float = 0.0
) -> cla.Array:
    """(1, n1, `row_pitch(n2)`) complex64: the cross-power of batched images, summed over the images; arguments as in
    `cross_power`."""
    n0, n1, n2 = shape
    pitch = _require_pair(target, source, shape)
    result = device.empty((1, n1, pitch), np.complex64)
    gains = table(device, full_gain(n1, blur)), table(device, half_gain(n2, blur))
    arguments = target, source, result, *gains, np.int32(n0), np.int32(n1), np.int32(pitch)
    launch(device, "pomf/spectrum", "sum_layers", (pitch // lanes(device), n1), *arguments, group="columns")
    return result


def _require_edges(*edges: int) -> None:
    if any(edge not in EDGES for edge in edges):
        raise InputError(f"transformed axes have {edges} voxels; wanted {KINDS}")


def _require_pair(target: cla.Array, source: cla.Array, shape: tuple[int, int, int]) -> int:
    n0, n1, n2 = shape
    _require_edges(n2)
    pitch = row_pitch(n2)
    require_array(target, "target", (n0, n1, pitch), np.complex64)
    require_array(source, "source", (n0, n1, pitch), np.complex64)
    return pitch


def full_gain(n: int, blur: float) -> np.ndarray:
    """(n,) float32: the Gaussian along one axis, at the frequencies of a full transform."""
    if not blur >= 0:
        raise InputError(f"`blur={blur}` voxels; wanted 0 or more")
    return np.exp(-2 * (np.pi * blur * np.fft.fftfreq(n)) ** 2).astype(np.float32)


def half_gain(n: int, blur: float) -> np.ndarray:
    """(`row_pitch(n)`,) float32: the Gaussian along the halved axis, 0 in the padding."""
    padded = np.zeros(row_pitch(n), np.float32)
    padded[: n // 2 + 1] = full_gain(n, blur)[: n // 2 + 1]
    return padded


def half_weights(n: int) -> np.ndarray:
    """(`row_pitch(n)`,) float32: how often each number of the halved axis occurs in the full one; 0 in the padding."""
    weights = np.zeros(row_pitch(n), np.float32)
    weights[1 : n // 2] = 2
    weights[[0, n // 2]] = 1
    return weights


class Pomf:
    """Phase-only matched filtering (Sect. 2.1 of the paper) of volumes, or of images in batches.

    The correlation of `prepare`d target and source peaks at the shift s (cyclic) with
    target(x) = source(x - s): the source has to move by +s.
    """

    def __init__(self, device: Device, shape: tuple[int, int, int], blur: float = 0.0, batched: bool = False) -> None:
        """Plan the transforms.

        Args:
            shape: (n0, n1, n2) of the volumes; with batched, n0 counts images.
            blur: standard deviation of the Gaussian that correlations are convolved with [voxels].
            batched: transform along axes 1 and 2 only.
        """
        self.device, self.shape, self.blur, self.batched = device, shape, blur, batched
        self._fft = RealFFT(device, shape, batched=batched)
        image = (1, shape[1], shape[2])
        self._image_fft = RealFFT(device, image, batched=True) if batched else None
        self._scratch: cla.Array | None = None

    def transform(self, volume: cla.Array, out: cla.Array | None = None) -> cla.Array:
        """The half spectrum of a volume, not whitened; arguments, result and errors as in `prepare`."""
        return self._fft.forward(volume, out=out)

    def prepare(self, volume: cla.Array, out: cla.Array | None = None) -> cla.Array:
        """The whitened half spectrum (n0, n1, `row_pitch(n2)`) complex64 of a volume. Without `out` a new array is
        allocated, whose page faults take as long as the transform."""
        spectrum = self.transform(volume, out=out)
        return whiten(self.device, spectrum, out=spectrum)

    def correlate(self, target: cla.Array, source: cla.Array, out: cla.Array | None = None) -> cla.Array:
        """Correlation (n0, n1, n2) float32 of two spectra from `prepare`; image by image if batched."""
        blur = 0.0 if self.batched else self.blur, self.blur, self.blur
        self._scratch = cross_power(self.device, target, source, self.shape, blur, out=self._scratch)
        return self._fft.inverse(self._scratch, out=out)

    def correlate_layers(self, target: cla.Array, source: cla.Array) -> cla.Array:
        """Sum (n1, n2) float32 of the images' correlations of two batches from `prepare`."""
        if self._image_fft is None:
            raise InputError("correlate_layers sums over images: make the Pomf with batched=True")
        summed = sum_layers(self.device, target, source, self.shape, self.blur)
        return self._image_fft.inverse(summed).reshape(self.shape[1:])
