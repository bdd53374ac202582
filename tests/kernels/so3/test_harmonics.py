"""Spherical harmonics of a spectrum's layers equal quadrature in double precision (within 1e-5), and mixtures."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from sonarmap.kernels.so3.harmonics import Harmonics, equalizers
from tests.samples.pomf_twin import relative_error
from tests.samples.scenes.sphere_layers import random_coefficients, turned


def spectrum(edge, seed):
    """A magnitude spectrum with noise that decays with the radius, differently along each axis."""
    rng = np.random.default_rng(seed)
    i, j, k = np.meshgrid(
        np.arange(edge) - edge / 2, np.arange(edge) - edge / 2, np.arange(edge / 2 + 1), indexing="ij"
    )
    values = np.exp(-np.sqrt(i**2 + 2 * j**2 + 0.3 * k**2) / edge) + 0.2 * rng.random(i.shape)
    return values.astype(np.float32)


def sampled(magnitude, harmonics, radii):
    """(L, latitudes, longitudes) float64, each layer with mean 0 and variance 1 over the sphere."""
    half = len(magnitude) / 2
    places = radii[:, None, None, None] * harmonics.directions.astype(np.float64) + [half, half, 0]
    layers = map_coordinates(magnitude.astype(np.float64), places.reshape(-1, 3).T, order=1).reshape(places.shape[:-1])
    weights = quadrature(layers.shape[1])[1]
    means = layers.mean(axis=2) @ weights / weights.sum()
    layers = layers - means[:, None, None]
    return layers / np.sqrt(np.square(layers).mean(axis=2) @ weights / weights.sum())[:, None, None]


def quadrature(latitudes):
    heights, weights = np.polynomial.legendre.leggauss(2 * latitudes)
    return heights[latitudes:], weights[latitudes:]


def coefficients_of(layers, bandwidth):
    """The twin: the integral in float64 over both hemispheres, which are equal at opposite points."""
    _, latitudes, longitudes = layers.shape
    heights, weights = quadrature(latitudes)
    azimuths = np.arange(longitudes) * 2 * np.pi / longitudes
    result = np.zeros((bandwidth // 2, len(layers), 2 * bandwidth - 1), np.complex128)
    for order in range(1 - bandwidth, bandwidth):
        around = layers @ np.exp(-1j * order * azimuths) * (2 * weights * 2 * np.pi / longitudes)
        for half in range((abs(order) + 1) // 2, bandwidth // 2):
            along = np.real(sph_harm_y(2 * half, order, np.arccos(heights), 0.0))
            result[half, :, order + bandwidth - 1] = around @ along
    return result


class TestAnalyze:
    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize(
        ("bandwidth", "latitudes", "longitudes", "edge", "layers"),
        [(8, 16, 20, 32, 3), (16, 32, 44, 32, 5), (48, 96, 256, 64, 3)],
    )
    def test_equals_direct_quadrature_of_the_samples(self, device, bandwidth, latitudes, longitudes, edge, layers):
        harmonics = Harmonics(device, bandwidth, latitudes, longitudes)
        magnitude, radii = spectrum(edge, layers), np.linspace(0.1, 0.45, layers) * edge
        got = harmonics.analyze(device.to_device(magnitude), radii)
        assert got.dtype == np.complex64
        want = coefficients_of(sampled(magnitude, harmonics, radii), bandwidth)
        np.testing.assert_allclose(got.get(), want, atol=2e-5)
        assert relative_error(got.get(), want) < 1e-5
        products = harmonics.products(got).get()
        np.testing.assert_allclose(products, np.real(want @ want.conj().transpose(0, 2, 1)), atol=5e-5)

    def test_each_layer_has_mean_0_and_variance_1_over_the_sphere(self, device):
        harmonics = Harmonics(device, 16, 32, 64)
        magnitude = 900 + 7 * spectrum(32, 9)  # a mean of 130 standard deviations
        got = harmonics.products(harmonics.analyze(device.to_device(magnitude), np.array([3.0, 9.0]))).get()
        # squares of the means, which in single precision are below 0.3 % of a standard deviation
        np.testing.assert_allclose(got[0], 0, atol=1e-5)
        energy = np.trace(got, axis1=1, axis2=2).sum() / 2
        assert 0.2 * 4 * np.pi < energy < 4 * np.pi * 1.001  # higher degrees have the rest
        flat = device.to_device(np.full((16, 16, 9), 7.3, np.float32))  # a constant layer becomes 0
        assert not harmonics.analyze(flat, np.array([2.0, 5.0])).get().any()


@pytest.mark.parametrize(("bandwidth", "layers", "sums"), [(8, 1, 1), (16, 20, 49)])
def test_mixtures_equal_the_matrix_product(device, bandwidth, layers, sums):
    harmonics = Harmonics(device, bandwidth, 32, 96)
    coefficients = random_coefficients(bandwidth, layers, 1).astype(np.complex64)
    mixtures = np.random.default_rng(2).normal(size=(bandwidth // 2, sums, layers))
    got = harmonics.mix(device.to_device(coefficients), mixtures).get()
    np.testing.assert_allclose(got, mixtures @ coefficients, atol=1e-4)


def equalize(coefficients, power):
    """Coefficients after equalizing, in float64."""
    return equalizers(np.real(coefficients @ coefficients.conj().transpose(0, 2, 1)), power) @ coefficients


class TestEqualize:
    @pytest.mark.parametrize("layers", [3, 30])
    @pytest.mark.parametrize("power", [0.4, 1.0])
    def test_equalizing_commutes_with_rotation(self, power, layers):
        coefficients = random_coefficients(8, layers, seed=10, decay=1)
        R = Rotation.from_euler("ZYX", [40, -25, 70], degrees=True)
        got = equalize(turned(coefficients, R), power)
        assert relative_error(got, turned(equalize(coefficients, power), R)) < 1e-9
        # unchanged coefficients would pass, too
        assert relative_error(equalize(coefficients, power)[1:], coefficients[1:]) > 0.05

    @pytest.mark.parametrize("power", [0.4, 1.0])
    def test_equals_the_power_of_the_orders_products(self, power):
        """G^(-power / 2) of the 2 l + 1 orders, in float64: power 1 makes the directions of a degree equally strong."""
        coefficients = random_coefficients(8, 30, seed=16)
        part = coefficients[2, :, 3:12]
        values, vectors = np.linalg.eigh(part.T.conj() @ part)
        want = part @ (vectors * values ** (-power / 2)) @ vectors.conj().T
        want *= np.linalg.norm(part) / np.linalg.norm(want)
        assert relative_error(equalize(coefficients, power)[2, :, 3:12], want) < 1e-9

    def test_rounding_errors_are_not_amplified(self):
        """Two layers span 2 of 9 directions; the others contain only rounding errors."""
        coefficients = random_coefficients(8, 2, seed=12)
        got = equalize(coefficients, 1)[2, :, 3:12]
        assert np.linalg.svd(got, compute_uv=False).min() > 0.9 * np.linalg.norm(got) / np.sqrt(2)
        basis = np.linalg.svd(coefficients[2, :, 3:12])[2][2:]
        assert np.abs(got @ basis.conj().T).max() < 1e-4 * np.linalg.norm(got)

    def test_zeros_stay_zeros_and_the_mean_becomes_zero(self):
        coefficients = random_coefficients(8, 3, seed=14)
        coefficients[2] = 0
        got = equalize(coefficients, 0.4)
        assert not got[0].any()
        assert not got[2].any()
        assert got[1].any()
        assert not equalize(np.zeros((4, 3, 15)), 1).any()
        assert equalize(np.zeros((4, 0, 15)), 1).shape == (4, 0, 15)
