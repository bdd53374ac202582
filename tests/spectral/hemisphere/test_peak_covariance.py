"""The first covariance: its shape follows the peak, its frame is the source's body tangent."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.pomf.peak import Peak
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere.covariance import peak_covariance, peak_width


def gaussian_peak(cov: np.ndarray, psr: float = 200.0) -> Peak:
    steps = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1)
    exponent = np.einsum("...i,ij,...j->...", steps, np.linalg.inv(cov), steps)
    neighborhood = np.exp(-0.5 * exponent).astype(np.float32)
    return Peak(np.zeros(3, int), np.zeros(3), 1.0, 1.0, psr, neighborhood, 0.0, 1.0)


def test_width_is_that_of_the_gaussian() -> None:
    cov = np.array([[1.5, 0.3, 0.0], [0.3, 2.0, -0.2], [0.0, -0.2, 1.2]])
    np.testing.assert_allclose(peak_width(gaussian_peak(cov)), cov, rtol=1e-4, atol=1e-4)
    # a ridge is as wide as the neighborhood can tell
    ridge = gaussian_peak(np.diag([1.0, 1e6, 1.0]))
    np.testing.assert_allclose(np.diag(peak_width(ridge)), [1, 9, 1], rtol=1e-3)


def test_translation_is_turned_into_the_frame_of_the_source() -> None:
    R = Rotation.from_euler("Z", 90, degrees=True)
    wide_x = peak_covariance(gaussian_peak(np.diag([4.0, 1.0, 1.0])), R, np.zeros(3), Grid(128, 0.5), 0.02)
    sigmas = np.diag(wide_x)[3:]
    assert sigmas[1] == pytest.approx(4 * sigmas[0], rel=1e-3)  # the target's x is the source's -y
    assert sigmas[2] == pytest.approx(sigmas[0], rel=1e-3)


def test_covariance_is_about_the_sensor_and_holds_for_the_right_tangent() -> None:
    """Against Monte Carlo: errors drawn about the grid's center, seen at the sensor."""
    R, center, voxel, bin_angle = (Rotation.from_euler("ZYX", [0.5, -0.2, 0.1]), np.array([7.0, -3.0, 2.0]), 0.5, 0.03)
    peak = gaussian_peak(np.diag([2.0, 1.0, 1.5]))
    stated = peak_covariance(peak, R, center, Grid(128, voxel), bin_angle)
    np.testing.assert_allclose(stated, stated.T)
    rng = np.random.default_rng(5)
    count = 20_000
    turns = Rotation.from_rotvec(rng.normal(0, bin_angle / np.sqrt(12), (count, 3)))
    shifts = rng.normal(size=(count, 3)) * np.sqrt(np.array([2.0, 1.0, 1.5]) * voxel**2 / 12)
    T = RigidTransform.from_components([4.0, 5.0, 6.0], R)
    place = T.apply(center) + shifts - (R * turns).apply(np.tile(center, (count, 1)))
    xi = (T.inv() * RigidTransform.from_components(place, R * turns)).as_exp_coords()
    np.testing.assert_allclose(np.cov(xi.T), stated, atol=0.03 * np.abs(stated).max())


def test_a_low_peak_is_less_certain() -> None:
    peaks = (gaussian_peak(np.eye(3), psr) for psr in (100.0, 30.0))
    high, low = (peak_covariance(peak, Rotation.identity(), np.zeros(3), Grid(128, 1.0), 0.02) for peak in peaks)
    assert np.all(np.diag(low) > 3.9 * np.diag(high))
