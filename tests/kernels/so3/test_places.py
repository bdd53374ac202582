"""Places of rotations in a correlation over all rotations: the inverse of the rotations at places."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.so3.correlation import RotationCorrelation

BANDWIDTH = 16
STEP = np.pi / (2 * BANDWIDTH)


@pytest.fixture(scope="module")
def correlation(device) -> RotationCorrelation:
    return RotationCorrelation(device, BANDWIDTH)


def off(correlation: RotationCorrelation, R: Rotation) -> np.ndarray:
    """How far the rotations at the places of rotations are from these, (n,) [rad]."""
    return (correlation.rotations(correlation.places(R)).inv() * R).magnitude()


def from_beta(beta: np.ndarray | float, count: int, seed: int) -> Rotation:
    """Rotations whose z axes are so far from z [rad], otherwise any."""
    first, third = np.random.default_rng(seed).uniform(-np.pi, np.pi, (2, count))
    return Rotation.from_euler("ZYZ", np.column_stack([first, np.broadcast_to(beta, count), third]))


def test_of_random_rotations(correlation: RotationCorrelation) -> None:
    R = Rotation.random(2000, rng=np.random.default_rng(1))
    within = np.abs(np.arccos(R.as_matrix()[:, 2, 2]) - np.pi / 2) < (np.pi - STEP) / 2
    assert within.mean() > 0.99
    np.testing.assert_allclose(off(correlation, R[within]), 0, atol=1e-6)


def test_of_samples(correlation: RotationCorrelation) -> None:
    """Whole numbers, of one period."""
    rng = np.random.default_rng(2)
    edge = correlation.edge
    index = rng.integers(0, [len(correlation.betas), edge, edge], (500, 3))
    places = correlation.places(correlation.rotations(index))
    assert (places >= 0).all()
    assert (places[:, 1:] <= edge).all()
    around = (places - index + edge / 2) % edge - edge / 2
    np.testing.assert_allclose(around, 0, atol=1e-6)


def test_of_turns_about_z_alone(correlation: RotationCorrelation) -> None:
    """The first sample is half a step off: the other two are right together."""
    R = Rotation.from_euler("Z", np.linspace(-3.1, 3.1, 50)[:, None])
    places = correlation.places(R)
    np.testing.assert_array_equal(places[:, 0], 0)
    turn = places[:, 1:].sum(axis=1) * 2 * np.pi / correlation.edge
    np.testing.assert_allclose(np.cos(turn - np.linspace(-3.1, 3.1, 50)), 1, atol=1e-9)
    np.testing.assert_allclose(off(correlation, R), STEP / 2, atol=1e-6)


@pytest.mark.parametrize("beta", [1e-9, 1e-5, 0.01, STEP / 2.5])
def test_of_nearly_level_ones_nothing_is_farther_than_the_first_sample(correlation, beta):
    R = from_beta(beta, 200, 3)
    places = correlation.places(R)
    np.testing.assert_array_equal(places[:, 0], 0)
    assert off(correlation, R).max() < STEP / 2 + 1e-5


@pytest.mark.parametrize("beta", [np.pi, np.pi - 1e-9, np.pi - 1e-4, np.pi - STEP / 3])
def test_of_those_upside_down_nothing_is_farther_than_the_last_sample(correlation, beta):
    R = from_beta(beta, 200, 4)
    places = correlation.places(R)
    np.testing.assert_array_equal(places[:, 0], len(correlation.betas) - 1)
    assert off(correlation, R).max() < STEP / 2 + 1e-5


def test_beyond_the_largest_tilt_it_is_the_last_sample(device) -> None:
    correlation = RotationCorrelation(device, BANDWIDTH, 0.5)
    last = correlation.betas[-1]
    R = from_beta(1.2, 200, 5)
    places = correlation.places(R)
    np.testing.assert_array_equal(places[:, 0], len(correlation.betas) - 1)
    np.testing.assert_allclose(off(correlation, R), 1.2 - last, atol=1e-6)
