"""Correlation over all rotations: Wigner's matrices, a direct sum in double precision, rotations found again."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from sonarmap.kernels.errors import DeviceError, InputError
from sonarmap.kernels.so3.correlation import RotationCorrelation, wigner_d
from tests.samples.refusals import refuses
from tests.samples.scenes.sphere_layers import evaluate, random_coefficients, turned


class TestWigner:
    def test_closed_form_of_degrees_1_and_2(self):
        b = np.array([0.0, 0.3, 1.1, np.pi / 2, 2.9, np.pi, -0.4])
        c, s = np.cos(b), np.sin(b)
        got = wigner_d(1, b)  # rows are m = -1, 0, 1
        np.testing.assert_allclose(got[:, 2, 2], (1 + c) / 2, atol=1e-14)
        np.testing.assert_allclose(got[:, 2, 1], -s / np.sqrt(2), atol=1e-14)
        np.testing.assert_allclose(got[:, 2, 0], (1 - c) / 2, atol=1e-14)
        np.testing.assert_allclose(got[:, 1, 2], s / np.sqrt(2), atol=1e-14)
        np.testing.assert_allclose(got[:, 1, 1], c, atol=1e-14)
        got = wigner_d(2, b)  # rows are m = -2..2
        np.testing.assert_allclose(got[:, 4, 4], (1 + c) ** 2 / 4, atol=1e-14)
        np.testing.assert_allclose(got[:, 4, 3], -s * (1 + c) / 2, atol=1e-14)
        np.testing.assert_allclose(got[:, 4, 2], np.sqrt(6) / 4 * s**2, atol=1e-14)
        np.testing.assert_allclose(got[:, 3, 3], (2 * c**2 + c - 1) / 2, atol=1e-14)
        np.testing.assert_allclose(got[:, 2, 2], (3 * c**2 - 1) / 2, atol=1e-14)

    @pytest.mark.parametrize("degree", [0, 1, 2, 5, 12])
    def test_equals_the_matrix_exponential(self, degree):
        orders = np.arange(-degree, degree + 1)
        raising = np.zeros((len(orders), len(orders)))
        for n, m in enumerate(orders[:-1]):
            raising[n + 1, n] = np.sqrt((degree - m) * (degree + m + 1))
        for beta in (0.2, 1.7, 3.0):
            want = expm(-beta / 2 * (raising - raising.T))
            np.testing.assert_allclose(wigner_d(degree, np.array([beta]))[0], want, atol=1e-12)

    @pytest.mark.parametrize("degree", [2, 7, 46, 94])
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
    """Random samples of the correlation, first and last second angle among them."""
    rng = np.random.default_rng(seed)
    places = rng.integers(0, [len(correlation.betas), correlation.edge, correlation.edge], (count, 3))
    places[0, 0], places[1, 0] = 0, len(correlation.betas) - 1
    return places


def correlated(correlation, target, source):
    """All layers together, on the host."""
    return correlate(correlation, target, source)[0]


def correlate(correlation, target, source, parts=None):
    coefficients = (correlation.device.to_device(each.astype(np.complex64)) for each in (target, source))
    return correlation.correlate(*coefficients, parts).get()


class TestCorrelation:
    @pytest.mark.parametrize(
        ("bandwidth", "largest", "layers"), [(8, np.pi, 1), (8, 0.5, 3), (16, np.deg2rad(50), 2), (24, 1e-9, 2)]
    )
    def test_equals_the_direct_sum_over_turned_layers(self, device, bandwidth, largest, layers):
        correlation = RotationCorrelation(device, bandwidth, largest)
        target, source = (random_coefficients(bandwidth, layers, seed) for seed in (1, 2))
        got = correlated(correlation, target, source)
        assert got.shape == (len(correlation.betas) + 1, correlation.edge, correlation.edge)
        assert not got[-1].any()
        largest_value = np.linalg.norm(target) * np.linalg.norm(source)
        for place in places_of(correlation, 4 if bandwidth > 8 else 8, seed=3):
            want = direct(target, source, correlation.rotations(place))
            assert got[tuple(place)] == pytest.approx(want, abs=2e-6 * float(largest_value))

    @pytest.mark.parametrize("bandwidth", [32, 40, 48, 64])
    def test_equals_the_sum_of_the_formula(self, device, bandwidth):
        """Larger bandwidths against C(R) as the module's docstring has it, in float64."""
        correlation = RotationCorrelation(device, bandwidth, 0.3)
        target, source = (random_coefficients(bandwidth, 5, seed) for seed in (4, 5))
        got = correlated(correlation, target, source)
        orders = np.arange(1 - bandwidth, bandwidth)
        places = places_of(correlation, 12, seed=6)
        want = np.zeros(len(places))
        for half in range(bandwidth // 2):
            part = slice(bandwidth - 1 - 2 * half, bandwidth + 2 * half)
            product = target[half, :, part].T @ source[half, :, part].conj()
            matrices = wigner_d(2 * half, correlation.betas[places[:, 0]])
            alpha, gamma = (2j * np.pi / correlation.edge * places[:, axis] for axis in (1, 2))
            waves = np.exp(np.multiply.outer(alpha, orders[part])), np.exp(np.multiply.outer(gamma, orders[part]))
            want += np.einsum("mn,pmn,pm,pn->p", product, matrices, *waves).real
        scale = float(np.linalg.norm(target) * np.linalg.norm(source))
        np.testing.assert_allclose(got[tuple(places.T)], want, atol=2e-6 * scale)
        assert np.abs(want).max() > 1e-3 * scale

    def test_calls_do_not_leave_traces(self, device):
        correlation = RotationCorrelation(device, 16, 1.0)
        many, few = random_coefficients(16, 7, 7), random_coefficients(16, 2, 8)
        first = correlated(correlation, few, few)
        correlated(correlation, many, many)
        np.testing.assert_array_equal(correlated(correlation, few, few), first)

    def test_zero_coefficients_give_zero(self, device):
        correlation = RotationCorrelation(device, 8, 1.0)
        zero = np.zeros((4, 2, 15), np.complex64)
        assert not correlated(correlation, zero, random_coefficients(8, 2, 9)).any()

    def test_refuses_what_it_cannot_use(self, device):
        correlation = RotationCorrelation(device, 8, 1.0)
        good = random_coefficients(8, 2, 10)
        for target, source in ((good[:2], good), (good, good[:2]), (good[..., 1:], good), (good, good[:, :1])):
            refuses(r"`(target|source)` is complex64 of shape", correlate, correlation, target, source)
        for parts in ([(0, 3)], [(1, 2)], [(-1, 1)], [(0, 1), (2, 1)]):
            refuses("go beyond the 2 layers", correlate, correlation, good, good, parts)

    @pytest.mark.parametrize(("bandwidth", "parts"), [(8, [(0, 2), (2, 5), (1, 1)]), (16, [(3, 4), (0, 1)])])
    def test_parts_are_as_if_alone(self, device, bandwidth, parts):
        correlation = RotationCorrelation(device, bandwidth, 0.8)
        target, source = (random_coefficients(bandwidth, 7, seed) for seed in (11, 12))
        together = correlate(correlation, target, source, parts)
        assert len(together) == len(parts)
        scale = float(np.linalg.norm(target) * np.linalg.norm(source))
        for (first, count), got in zip(parts, together, strict=True):
            alone = (each[:, first : first + count] for each in (target, source))
            np.testing.assert_allclose(got, correlated(correlation, *alone), atol=1e-6 * scale)

    @pytest.mark.parametrize("bandwidth", [0, 4, 12, 264])
    def test_refuses_other_bandwidths(self, device, bandwidth):
        with pytest.raises(InputError, match=f"`bandwidth={bandwidth}`, `largest`"):
            RotationCorrelation(device, bandwidth)

    @pytest.mark.parametrize("largest", [0.0, -1.0, 3.2, np.nan])
    def test_refuses_other_angles(self, device, largest):
        with pytest.raises(InputError, match="above 0 up to 180 degrees"):
            RotationCorrelation(device, 16, largest)

    def test_refuses_tables_beyond_the_device_before_it_computes_them(self, device, monkeypatch):
        monkeypatch.setattr("sonarmap.kernels.so3.correlation.wigner_d", lambda *_: pytest.fail("computed"))
        monkeypatch.setattr(type(device), "memory", 2**20)
        with pytest.raises(DeviceError, match="a smaller `bandwidth`"):
            RotationCorrelation(device, 48)


class TestSamples:
    @pytest.mark.parametrize(("bandwidth", "edge"), [(8, 16), (16, 32), (24, 64), (48, 128), (64, 128)])
    def test_they_cover_what_is_asked_for(self, device, bandwidth, edge):
        step = np.pi / (2 * bandwidth)
        for largest in (0.9, 1e-6):
            correlation = RotationCorrelation(device, bandwidth, largest)
            assert correlation.edge == edge
            np.testing.assert_allclose(np.diff(correlation.betas), step)
            assert correlation.betas[0] == pytest.approx(step / 2)
            # the last one is at or beyond it, and not by more than a step
            assert largest <= correlation.betas[-1] < largest + step

    def test_pi_is_all_of_them(self, device):
        correlation = RotationCorrelation(device, 16)
        assert len(correlation.betas) == 32
        assert correlation.betas[-1] == pytest.approx(np.pi - correlation.betas[0])

    def test_rotations_are_those_of_the_angles(self, device):
        correlation = RotationCorrelation(device, 16, 1.0)
        R = correlation.rotations(np.array([[[3, 5, 30], [0.5, 2.25, -1]]])).as_matrix()
        assert R.shape == (1, 2, 3, 3)
        for got, (b, i, j) in zip(R[0], [(3, 5, 30), (0.5, 2.25, -1)], strict=True):
            angles = i * np.pi / 16, (b + 0.5) * np.pi / 32, j * np.pi / 16
            want = np.linalg.multi_dot(
                [Rotation.from_euler(a, x).as_matrix() for a, x in zip("zyz", angles, strict=True)]
            )
            np.testing.assert_allclose(got, want, atol=1e-12)


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


class TestRotationsFoundAgain:
    """Rotations through `correlate` with nothing else: the highest sample is the nearest one, or next to it."""

    def peak(self, correlation, target, source):
        values = correlated(correlation, target, source)
        place = np.unravel_index(values.argmax(), values.shape)
        return correlation.rotations(np.array(place)), values[place]

    @pytest.mark.parametrize("R", TURNS)
    def test_a_turned_source_peaks_at_its_rotation(self, correlation, layers, R):
        source = turned(layers, R)
        peak_R, value = self.peak(correlation, layers, source)
        # a sample is half a step from its neighbors' border along each of three angles, of 5.6 and 11.25 degrees
        assert (peak_R * R.inv()).magnitude() < np.deg2rad(10)
        energy = np.linalg.norm(layers) ** 2
        assert 0.5 * energy < value <= energy * (1 + 1e-5)
        back, _ = self.peak(correlation, source, layers)
        assert (back * R).magnitude() < np.deg2rad(10)

    def test_at_a_sample_the_value_is_the_energy(self, correlation, layers):
        place = np.array([5, 3, 29])
        values = correlated(correlation, layers, turned(layers, correlation.rotations(place)))
        assert np.unravel_index(values.argmax(), values.shape) == tuple(place)
        assert values.max() == pytest.approx(np.linalg.norm(layers) ** 2, rel=1e-5)

    def test_the_helper_turns_as_it_says(self, layers):
        directions = Rotation.random(20, rng=np.random.default_rng(21)).as_matrix()[:, 1]
        R = TURNS[0]
        np.testing.assert_allclose(evaluate(turned(layers, R), directions), evaluate(layers, R.apply(directions)))
