"""Correlation over all rotations: Wigner matrices, comparison with a direct sum in float64, known rotations."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from sonarmap.kernels.errors import DeviceError
from sonarmap.kernels.so3.correlation import RotationCorrelation, wigner_d
from tests.samples.scenes.sphere_layers import random_coefficients, turned


class TestWigner:
    @pytest.mark.parametrize("degree", [1, 12])
    def test_equals_the_matrix_exponential(self, degree):
        orders = np.arange(-degree, degree + 1)
        raising = np.zeros((len(orders), len(orders)))
        for n, m in enumerate(orders[:-1]):
            raising[n + 1, n] = np.sqrt((degree - m) * (degree + m + 1))
        for beta in (0.2, 1.7, 3.0):
            want = expm(-beta / 2 * (raising - raising.T))
            np.testing.assert_allclose(wigner_d(degree, np.array([beta]))[0], want, atol=1e-12)

    @pytest.mark.parametrize("degree", [7, 94])
    def test_laws(self, degree):
        a, b = np.array([0.4, 1.9, 2.6]), np.array([0.7, -0.2, 1.3])
        first, second = wigner_d(degree, a), wigner_d(degree, b)
        np.testing.assert_allclose(first @ second, wigner_d(degree, a + b), atol=1e-11)
        np.testing.assert_allclose(
            first @ first.transpose(0, 2, 1), np.broadcast_to(np.eye(2 * degree + 1), first.shape), atol=1e-11
        )
        np.testing.assert_allclose(wigner_d(degree, -a), first.transpose(0, 2, 1), atol=1e-11)
        signs = (-1.0) ** np.abs(np.subtract.outer(np.arange(2 * degree + 1), np.arange(2 * degree + 1)))
        np.testing.assert_allclose(first[:, ::-1, ::-1], signs * first, atol=1e-11)


def direct(target, source, R):
    """The sum over the layers of the integrals of f(R d) g(d), in float64 and without a D-matrix."""
    return np.real(np.sum(turned(target, R) * source.conj()))


def places_of(correlation, count, seed):
    """Indices of random samples, including the first and the last second angle."""
    rng = np.random.default_rng(seed)
    places = rng.integers(0, [len(correlation.betas), correlation.edge, correlation.edge], (count, 3))
    places[0, 0], places[1, 0] = 0, len(correlation.betas) - 1
    return places


def correlate(correlation, target, source, parts=None):
    coefficients = (correlation.device.to_device(each.astype(np.complex64)) for each in (target, source))
    return correlation.correlate(*coefficients, parts).get()


class TestCorrelation:
    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize(
        ("bandwidth", "largest", "layers"),
        [(8, 0.5, 3), (16, np.deg2rad(50), 2), (24, 1e-9, 2)],
    )
    def test_equals_the_direct_sum_over_turned_layers(self, device, bandwidth, largest, layers):
        correlation = RotationCorrelation(device, bandwidth, largest)
        target, source = (random_coefficients(bandwidth, layers, seed) for seed in (1, 2))
        got = correlate(correlation, target, source)[0]
        assert got.shape == (len(correlation.betas) + 1, correlation.edge, correlation.edge)
        assert not got[-1].any()
        largest_value = np.linalg.norm(target) * np.linalg.norm(source)
        for place in places_of(correlation, 4 if bandwidth > 8 else 8, seed=3):
            want = direct(target, source, correlation.rotations(place))
            assert got[tuple(place)] == pytest.approx(want, abs=2e-6 * float(largest_value))

    def test_calls_are_independent_and_zero_coefficients_give_zero(self, device):
        correlation = RotationCorrelation(device, 16, 1.0)
        many, few = random_coefficients(16, 7, 7), random_coefficients(16, 2, 8)
        first = correlate(correlation, few, few)
        correlate(correlation, many, many)
        np.testing.assert_array_equal(correlate(correlation, few, few), first)
        assert not correlate(correlation, np.zeros_like(few), few).any()

    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize(("bandwidth", "parts"), [(8, [(0, 2), (2, 5), (1, 1)]), (16, [(3, 4), (0, 1)])])
    def test_parts_equal_separate_correlations(self, device, bandwidth, parts):
        correlation = RotationCorrelation(device, bandwidth, 0.8)
        target, source = (random_coefficients(bandwidth, 7, seed) for seed in (11, 12))
        together = correlate(correlation, target, source, parts)
        assert len(together) == len(parts)
        scale = float(np.linalg.norm(target) * np.linalg.norm(source))
        for (first, count), got in zip(parts, together, strict=True):
            alone = (each[:, first : first + count] for each in (target, source))
            np.testing.assert_allclose(got, correlate(correlation, *alone)[0], atol=1e-6 * scale)

    def test_tables_that_do_not_fit_are_refused_before_they_are_computed(self, device, monkeypatch):
        monkeypatch.setattr("sonarmap.kernels.so3.correlation.wigner_d", lambda *_: pytest.fail("computed"))
        monkeypatch.setattr(type(device), "memory", 2**20)
        with pytest.raises(DeviceError, match="a smaller `bandwidth`"):
            RotationCorrelation(device, 48)


class TestSamples:
    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize(("bandwidth", "edge"), [(8, 16), (24, 64)])
    def test_tilts_cover_the_largest_one(self, device, bandwidth, edge):
        step = np.pi / (2 * bandwidth)
        for largest in (0.9, 1e-6):
            correlation = RotationCorrelation(device, bandwidth, largest)
            assert correlation.edge == edge
            np.testing.assert_allclose(correlation.betas, step * (np.arange(len(correlation.betas)) + 0.5))
            # the last tilt is the largest one or less than a step beyond it
            assert largest <= correlation.betas[-1] < largest + step
        assert len(RotationCorrelation(device, 16).betas) == 32


TURNS = [
    Rotation.from_euler("ZYX", [100, -25, 12], degrees=True),
    Rotation.from_euler("ZYX", [-37, 64, 151], degrees=True),
    Rotation.from_euler("ZYZ", [71, 0, -20], degrees=True),
    Rotation.from_euler("ZYZ", [140, 0.4, 33], degrees=True),
    Rotation.from_euler("ZYZ", [-55, 179.5, 10], degrees=True),
    Rotation.from_euler("ZYZ", [8, 180, 0], degrees=True),
    Rotation.identity(),
]


@pytest.fixture(scope="module")
def layers():
    return random_coefficients(16, 6, seed=20)


@pytest.fixture(scope="module")
def correlation(device):
    return RotationCorrelation(device, 16)


class TestKnownRotations:
    """The highest sample of the correlation of rotated layers is the nearest one, or next to it."""

    @pytest.mark.parametrize("R", TURNS)
    def test_rotated_source_peaks_at_its_rotation(self, correlation, layers, R):
        source, energy = turned(layers, R), np.linalg.norm(layers) ** 2
        for target, other, want in ((layers, source, R), (source, layers, R.inv())):
            values = correlate(correlation, target, other)[0]
            place = np.unravel_index(values.argmax(), values.shape)
            # a sample is half a step from its neighbors' border along each of three angles, of 5.6 and 11.25 degrees
            assert (correlation.rotations(np.array(place)) * want.inv()).magnitude() < np.deg2rad(10)
            assert 0.5 * energy < values[place] <= energy * (1 + 1e-5)


def from_beta(beta: float, count: int, seed: int) -> Rotation:
    """Random rotations that tilt the z axis by `beta` [rad]."""
    first, third = np.random.default_rng(seed).uniform(-np.pi, np.pi, (2, count))
    return Rotation.from_euler("ZYZ", np.column_stack([first, np.full(count, beta), third]))


STEP = np.pi / 32  # angle between samples of `correlation`


class TestPlaces:
    """`places` is the inverse of `rotations`."""

    def off(self, correlation: RotationCorrelation, R: Rotation) -> np.ndarray:
        """(n,) [rad]: the angles between rotations and those at their places."""
        return (correlation.rotations(correlation.places(R)).inv() * R).magnitude()

    def test_of_random_rotations(self, correlation):
        R = Rotation.random(2000, rng=np.random.default_rng(1))
        within = np.abs(np.arccos(R.as_matrix()[:, 2, 2]) - np.pi / 2) < (np.pi - STEP) / 2
        assert within.mean() > 0.99
        np.testing.assert_allclose(self.off(correlation, R[within]), 0, atol=1e-6)

    @pytest.mark.parametrize("level", [0, 1e-5, STEP / 2.5])
    @pytest.mark.parametrize("upside_down", [False, True])
    def test_tilts_near_0_or_pi_belong_to_the_end_sample(self, correlation, level, upside_down):
        R = from_beta(np.pi - level if upside_down else level, 200, 3)
        end = len(correlation.betas) - 1 if upside_down else 0
        np.testing.assert_array_equal(correlation.places(R)[:, 0], end)
        assert self.off(correlation, R).max() < STEP / 2 + 1e-5

    def test_tilts_beyond_the_largest_belong_to_the_last_sample(self, device):
        correlation = RotationCorrelation(device, 16, 0.5)
        R = from_beta(1.2, 200, 5)
        np.testing.assert_array_equal(correlation.places(R)[:, 0], len(correlation.betas) - 1)
        np.testing.assert_allclose(self.off(correlation, R), 1.2 - correlation.betas[-1], atol=1e-6)
