"""Kernels refuse wrong shapes, types, numbers and bounds before they compute."""

from collections.abc import Callable

import numpy as np
import pytest

from sonarmap.kernels.device.arrays import upload_poses
from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.transform import RealFFT
from sonarmap.kernels.points.voxelize import scaled, voxelize
from sonarmap.kernels.pomf.peak import find_peaks
from sonarmap.kernels.pomf.spectrum import Pomf, cross_power, magnitude, whiten
from sonarmap.kernels.resample.layers import (
    normalize_layers,
    polar_magnitude,
    rectangular_unwrap,
    sample,
    upload_directions,
)
from sonarmap.kernels.so3.correlation import RotationCorrelation
from sonarmap.kernels.so3.harmonics import Harmonics, equalizers

ANGLES, EYE = np.arange(8.0), np.eye(3)[None]


def spectrum(device: Device, *shape: int) -> Array:
    return device.empty(shape, np.complex64)


def cube(device: Device) -> Array:
    return spectrum(device, 16, 16, 16)


def not_finite(device: Device) -> Array:
    volume = np.zeros((16, 16, 16), np.float32)
    volume[3, 4, 5] = np.nan
    return device.to_device(volume)


CASES: dict[str, Callable] = {
    "even products of 2, 3 and 5 from 16 to 512": lambda d: RealFFT(d, (28, 32, 64)),
    "the last two of them even": lambda d: RealFFT(d, (0, 32, 32), batched=True),
    "`volume` is float64": lambda d: RealFFT(d, (16, 16, 16)).forward(d.to_device(np.zeros((16, 16, 16)))),
    "in C order": lambda d: RealFFT(d, (16, 16, 16)).forward(d.empty((16, 16, 17))[:, :, 1:]),
    "`R` and `t` have shapes": lambda d: upload_poses(d, EYE, np.zeros((2, 3))),
    "finite": lambda d: upload_poses(d, EYE, np.array([[0, np.inf, 0]])),
    "`points` is": lambda d: scaled(d, d.empty((5, 3)), 0.5),
    "rotation": lambda d: voxelize(d, d.empty((5, 4)), 16, R=np.ones((3, 3))),
    "even": lambda d: voxelize(d, d.empty((5, 4)), 15),
    "not finite": lambda d: find_peaks(d, not_finite(d)),
    "limits": lambda d: find_peaks(d, d.empty((16, 16, 16)), limits=(1, -1, None)),
    "`spectrum` is complex64": lambda d: magnitude(d, cube(d), 32),
    "multiple of 8": lambda d: whiten(d, spectrum(d, 16, 9)),
    r"`exponent=.*give 0, plain correlation, to 1": lambda d: whiten(d, cube(d), float("nan")),
    "blur": lambda d: cross_power(d, cube(d), cube(d), (16, 16, 16), blur=(0, -1, 0)),
    "batched=True": lambda d: Pomf(d, (16, 16, 16)).correlate_layers(cube(d), cube(d)),
    "`window` is": lambda d: normalize_layers(d, d.empty((2, 8, 8)), d.empty((8, 16))),
    "below 7 bins": lambda d: polar_magnitude(d, spectrum(d, 2, 16, 16), (16, 16), np.array([7.0]), ANGLES),
    "`magnitude` is": lambda d: sample(
        d, d.empty((16, 16, 16)), upload_directions(d, rectangular_unwrap(16, "x")), np.array([3.0])
    ),
    "unit vectors": lambda d: upload_directions(d, 2 * rectangular_unwrap(16, "x")),
    "`radii` are": lambda d: Harmonics(d, 8, 16, 16).analyze(d.empty((16, 16, 9)), np.array([7.0])),
    "`bandwidth=12` with": lambda d: Harmonics(d, 12, 16, 32),
    "power.*wanted 0 to 1": lambda d: equalizers(np.ones((4, 3, 3)), np.nan),
    "products.* not finite": lambda d: equalizers(np.full((4, 3, 3), np.nan), 0.4),
    "above 0 up to 180 degrees": lambda d: RotationCorrelation(d, 16, 3.2),
    "`(target|source)` is complex64 of shape": lambda d: RotationCorrelation(d, 8, 1.0).correlate(
        spectrum(d, 4, 2, 14), spectrum(d, 4, 2, 14)
    ),
    "beyond the 2 layers": lambda d: RotationCorrelation(d, 8, 1.0).correlate(
        spectrum(d, 4, 2, 15), spectrum(d, 4, 2, 15), [(1, 2)]
    ),
}


@pytest.mark.parametrize("words", CASES)
def test_unusable_input_is_refused(device: Device, words: str) -> None:
    with pytest.raises(InputError, match=words):
        CASES[words](device)
