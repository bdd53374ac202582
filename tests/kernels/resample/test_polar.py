"""Polar samples of image spectra equal scipy.ndimage's (relative L2 within 5e-5); rotation shifts them."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from sonarmap.kernels.resample.layers import polar_magnitude
from tests.samples.pomf_twin import padded, relative_error


@pytest.mark.parametrize("shape", [(1, 16, 16), (5, 32, 64)])
@pytest.mark.parametrize("turns", [0.5, 1.0])
def test_equals_scipy_on_the_whole_spectrum(device, shape, turns):
    layers, height, width = shape
    images = np.random.default_rng(layers).normal(size=shape)
    radii, angles = np.linspace(0, min(height, width) / 2 - 1.01, 9), np.arange(40) * 2 * np.pi * turns / 40
    u, v = np.outer(radii, np.cos(angles)) + height / 2, np.outer(radii, np.sin(angles)) + width / 2
    whole = np.fft.fftshift(np.abs(np.fft.fft2(images)), axes=(1, 2))
    want = np.array([map_coordinates(layer, [u, v], order=1) for layer in whole])
    spectra = device.to_device(padded(np.fft.rfft2(images), width))
    got = polar_magnitude(device, spectra, (height, width), radii, angles).get()
    assert relative_error(got, want) <= 5e-5


def test_rotation_of_the_image_shifts_the_samples(device):
    """I_R(v) = I(Rz(psi) v), smooth and analytic: its samples are those of I at the angle + psi."""
    edge, count, m = 64, 48, 5
    psi = m * np.pi / count
    v = np.arange(edge) - edge / 2
    vx, vy = np.meshgrid(v, v, indexing="ij")

    def image(x, y):
        return np.exp(-((x / 3.0) ** 2) - (y / 1.7) ** 2) + np.exp(-(((x - 4) / 1.9) ** 2) - ((y - 2) / 2.3) ** 2)

    turned = image(np.cos(psi) * vx - np.sin(psi) * vy, np.sin(psi) * vx + np.cos(psi) * vy)
    spectra = padded(np.fft.rfft2(np.stack([image(vx, vy), turned])), edge)
    radii, angles = np.linspace(2, 14, 8), np.arange(count) * np.pi / count
    plain, shifted = polar_magnitude(device, device.to_device(spectra), (edge, edge), radii, angles).get()
    assert relative_error(shifted, np.roll(plain, -m, axis=1)) < 0.02
    assert relative_error(shifted, np.roll(plain, m, axis=1)) > 0.2
