"""The paper's rotation: hemisphere layers of the magnitude spectrum turn yaw, then roll and pitch, into shifts.

Each step estimates the remaining rotation: the source's spectrum is sampled along directions turned by the part of
R_target_source that is already known, so turning it back costs no second interpolation.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.fft.transform import RealFFT
from sonarmap.kernels.pomf.peak import find_peaks
from sonarmap.kernels.pomf.spectrum import Pomf
from sonarmap.kernels.resample.layers import (
    normalize_layers,
    polar_magnitude,
    rectangular_unwrap,
    rotational_unwrap,
    sample,
    upload_directions,
    valid_pixels,
)
from sonarmap.spectral.grid import image_edge

# Sect. 2.8: radii of the layers, as shares of N/2; one layer per frequency bin.
_LAYERS = (0.2, 0.8)
# Sect. 2.5: range of the radial axis of the 2D spectra that the yaw is estimated from.
_RADIAL = (0.11, 0.45)
# Standard deviations of the Gaussians that correlations are smoothed with before the peak search [bins]: distortion by
# the unwraps spreads the peaks.
_TILT_BLUR = 1.5
_YAW_BLUR = 1.5
_YAW_BLUR_ANGLE = np.deg2rad(1.0)  # minimum of the yaw's [rad], as the distortion is an angle
_LARGEST_IMAGE = 512  # [pixels]
_TILT_PEAKS = 4  # peaks of roll and pitch to try until a rotation is allowed
_TILT_SEPARATION = 3.0  # minimum distance between these peaks [bins]


@dataclass(frozen=True, slots=True)
class AngleEstimate:
    """A rotation R with R_target_source = R R_known, and the peak-to-sidelobe ratio of its correlation peak [standard
    deviations above the mean]."""

    R: Rotation
    psr: float


@dataclass(frozen=True, slots=True)
class LayerSpectra:
    """Whitened spectra of a scan's layers, on the device."""

    yaw: Array
    tilt: Array


class Hemisphere:
    """Resampling and matching of hemisphere layers on one grid: Sects. 2.4 to 2.9 of the paper."""

    def __init__(self, device: Device, edge: int) -> None:
        """Plan the images and transforms for volumes of `edge` voxels; images have `image_edge` pixels."""
        self.device, self.edge = device, edge
        self.radii = np.arange(_LAYERS[0] * edge / 2, min(_LAYERS[1] * edge / 2, edge / 2 - 1.01), dtype=np.float32)
        layers = len(self.radii)

        self.images = images = image_edge(edge)
        unwrap = rotational_unwrap(images)
        self._yaw_directions = upload_directions(device, unwrap)
        self._yaw_window = device.to_device(_radial_hann(images))
        self._yaw_mask = device.to_device(valid_pixels(unwrap))
        self._yaw_fft = RealFFT(device, (layers, images, images), batched=True)
        self._polar_shape = (max(images // 2, 16), min(2 * images, _LARGEST_IMAGE))
        self._polar_radii = np.linspace(*_RADIAL, self._polar_shape[0], dtype=np.float32) * (images / 2)
        self._polar_angles = np.arange(self._polar_shape[1], dtype=np.float32) * (np.pi / self._polar_shape[1])
        blur = max(_YAW_BLUR, _YAW_BLUR_ANGLE / self.yaw_bin)
        self._yaw_pomf = Pomf(device, (layers, *self._polar_shape), blur, batched=True)

        self._tilt_directions = [upload_directions(device, rectangular_unwrap(images, axis)) for axis in "yx"]
        self._tilt_window = device.to_device(np.outer(_hann(images), _hann(images)).astype(np.float32))
        self._tilt_pomf = Pomf(device, (2 * layers, images, images), _TILT_BLUR, batched=True)

    @property
    def yaw_bin(self) -> float:
        """Angle of one bin of the yaw correlation [rad]."""
        return np.pi / self._polar_shape[1]

    @property
    def tilt_bin(self) -> float:
        """Angle of one bin of the roll and pitch correlation [rad]."""
        return np.pi / self.images

    def prepare(self, magnitude: Array) -> LayerSpectra:
        """Layers of a scan's centered magnitude spectrum (edge, edge, edge/2 + 1)."""
        return LayerSpectra(self._yaw_spectra(magnitude), self._tilt_spectra(magnitude, None))

    def yaw_correlation(self, target: LayerSpectra, source: LayerSpectra) -> np.ndarray:
        """(bins,) float64 correlation by yaw (Sect. 2.5), in standard deviations above its mean; bin k is the yaw
        k yaw_bin, and also that + 180 degrees."""
        correlation = self._yaw_pomf.correlate_layers(target.yaw, source.yaw).get()
        # the true peak has no radial shift; sub-bin peaks may lie half a bin off
        row = correlation[[-1, 0, 1]].max(axis=0).astype(np.float64)
        mean, std = correlation.mean(dtype=np.float64), correlation.std(dtype=np.float64)
        return (row - mean) / std if std > 0 else np.zeros_like(row)

    def yaws(self, target: LayerSpectra, source: LayerSpectra) -> tuple[AngleEstimate, AngleEstimate]:
        """The yaw of the highest peak, and this + 180 degrees: magnitudes of 2D spectra have that period."""
        row = self.yaw_correlation(target, source)
        k = int(row.argmax())
        one, other = (Rotation.from_euler("Z", self._yaw_angle(row, k) + turn) for turn in (0.0, np.pi))
        return AngleEstimate(one, float(row[k])), AngleEstimate(other, float(row[k]))

    def tilt_correlation(self, target: LayerSpectra, source_magnitude: Array, R_known: Rotation) -> Array:
        """Correlation by the roll and pitch that remain after R_known (Sect. 2.6): device (images, images) float32, by
        cyclic shifts of (pitch, -roll) in tilt_bin, zero at [0, 0]."""
        return self._tilt_pomf.correlate_layers(target.tilt, self._tilt_spectra(source_magnitude, R_known))

    def tilt(
        self,
        target: LayerSpectra,
        source_magnitude: Array,
        R_known: Rotation,
        limit: float,
        allowed: Callable[[Rotation], bool] = lambda R: True,
    ) -> AngleEstimate | None:
        """Roll and pitch that remain after R_known (Sects. 2.6, 2.7), each within `limit` [rad].

        A rotation about x and y is nearly the same shift in both unwraps, so the estimate is the rotation vector (roll,
        pitch, 0) about the target's axes. It is that of the highest peak with an `allowed` R R_known; None if there is
        none.
        """
        correlation = self.tilt_correlation(target, source_magnitude, R_known)
        bins = limit / self.tilt_bin
        image = correlation.reshape((1, self.images, self.images))
        peaks = find_peaks(self.device, image, _TILT_PEAKS, _TILT_SEPARATION, limits=(None, bins, bins))
        for peak in peaks:
            pitch, roll = peak.shift[1] * self.tilt_bin, -peak.shift[2] * self.tilt_bin
            R = Rotation.from_rotvec([roll, pitch, 0.0])
            if allowed(R * R_known):
                return AngleEstimate(R, peak.psr)
        return None

    def _yaw_spectra(self, magnitude: Array) -> Array:
        layers = sample(self.device, magnitude, self._yaw_directions, self.radii)
        normalize_layers(self.device, layers, self._yaw_window, mask=self._yaw_mask, out=layers)
        spectrum = self._yaw_fft.forward(layers)
        polar = polar_magnitude(
            self.device, spectrum, (self.images, self.images), self._polar_radii, self._polar_angles
        )
        normalize_layers(self.device, polar, None, out=polar)
        return self._yaw_pomf.prepare(polar)

    def _tilt_spectra(self, magnitude: Array, R_known: Rotation | None) -> Array:
        layers = len(self.radii)
        stack = self.device.empty((2 * layers, self.images, self.images))
        # |B|(R^T k) is the source's magnitude spectrum turned by R
        turn = None if R_known is None else R_known.inv().as_matrix()
        for part, directions in zip((stack[:layers], stack[layers:]), self._tilt_directions, strict=True):
            sample(self.device, magnitude, directions, self.radii, turn, out=part)
        normalize_layers(self.device, stack, self._tilt_window, out=stack)
        return self._tilt_pomf.prepare(stack)

    def _yaw_angle(self, row: np.ndarray, k: int) -> float:
        """Angle of a peak of the yaw correlation [rad], interpolated between bins by a parabola."""
        left, middle, right = (float(row[(k + step) % len(row)]) for step in (-1, 0, 1))
        curvature = left - 2 * middle + right
        offset = 0.5 * (left - right) / curvature if curvature < 0 else 0.0
        return (k + float(np.clip(offset, -0.5, 0.5))) * self.yaw_bin


def _radial_hann(edge: int) -> np.ndarray:
    """Radial Hann window (edge, edge) float32 of the unwrap, 0 at the rim and beyond."""
    v = np.arange(edge) - edge / 2
    distance = np.hypot(*np.meshgrid(v, v, indexing="ij")) / (edge / 2)
    return (np.cos(np.pi / 2 * np.minimum(distance, 1.0)) ** 2).astype(np.float32)


def _hann(length: int) -> np.ndarray:
    """Periodic Hann window (length,)."""
    return np.sin(np.pi * np.arange(length) / length) ** 2
