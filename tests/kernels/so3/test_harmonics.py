"""Spherical harmonics of layers: against quadrature in double precision, and their laws (float32: 1e-5 relative)."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from kernels.errors import InputError
from kernels.so3.harmonics import Harmonics, equalize
from tests.samples.sphere_layers import evaluate, random_coefficients, turned

GRIDS = [(2, 1, 8), (8, 4, 16), (10, 16, 21), (16, 8, 40), (24, 30, 64)]


def relative(got, want):
    return np.linalg.norm(got - want) / np.linalg.norm(want)


class TestAnalyze:
    @pytest.mark.parametrize(("bandwidth", "latitudes", "longitudes"), GRIDS)
    def test_gives_the_coefficients_of_a_band_limited_layer_back(self, bandwidth, latitudes, longitudes):
        harmonics = Harmonics(bandwidth, latitudes, longitudes)
        want = random_coefficients(bandwidth, 3, seed=1)
        layers = evaluate(want, harmonics.directions.astype(np.float64))
        got = harmonics.analyze(layers.astype(np.float32))
        assert got.dtype == np.complex64
        assert got.shape == want.shape
        assert relative(got, want) < 1e-5
        # and back to the layer, at places that are no samples
        places = Rotation.random(50, rng=np.random.default_rng(2)).as_matrix()[:, 0]
        assert relative(evaluate(got, places), evaluate(want, places)) < 1e-5

    @pytest.mark.parametrize(("bandwidth", "latitudes", "longitudes"), [(8, 12, 40), (10, 16, 64)])
    def test_equals_direct_quadrature_of_any_even_layer(self, bandwidth, latitudes, longitudes):
        """A layer that is not band-limited: the twin sums over both hemispheres in float64."""
        harmonics = Harmonics(bandwidth, latitudes, longitudes)
        rng = np.random.default_rng(3)
        upper = rng.normal(size=(2, latitudes, longitudes))
        half_turn = np.roll(upper, longitudes // 2, axis=2)  # the value at -d
        heights, weights = np.polynomial.legendre.leggauss(2 * latitudes)
        layers = np.concatenate([half_turn[:, ::-1], upper], axis=1) * weights[:, None] * (2 * np.pi / longitudes)
        azimuths = np.arange(longitudes) * 2 * np.pi / longitudes
        got = harmonics.analyze(upper.astype(np.float32))
        for half in range(bandwidth // 2):
            for order in range(-2 * half, 2 * half + 1):
                conjugate = sph_harm_y(2 * half, order, np.arccos(heights)[:, None], azimuths[None, :]).conj()
                want = (layers * conjugate).sum(axis=(1, 2))
                np.testing.assert_allclose(got[half, :, order + bandwidth - 1], want, atol=2e-6)

    def test_parseval(self):
        """The energy of the coefficients is the mean square over the sphere, times 4 pi."""
        coefficients = random_coefficients(12, 4, seed=4)
        harmonics = Harmonics(12, 12, 32)
        layers = evaluate(coefficients, harmonics.directions.astype(np.float64))
        heights, weights = np.polynomial.legendre.leggauss(24)
        energy = 2 * (layers**2 * weights[12:, None]).sum(axis=(1, 2)) * (2 * np.pi / 32)
        got = np.square(np.abs(harmonics.analyze(layers))).sum(axis=(0, 2))
        np.testing.assert_allclose(got, energy, rtol=1e-5)
        np.testing.assert_allclose(heights[12:], harmonics.directions[:, 0, 2], atol=1e-6)

    def test_standardized_layers_have_mean_0_and_variance_1_over_the_sphere(self):
        """However a layer is turned: a plain mean over the samples would weigh the pole more than the equator."""
        coefficients = random_coefficients(12, 3, seed=5)
        harmonics = Harmonics(12, 16, 40)
        R = Rotation.from_euler("ZYX", (0.4, 1.1, -0.7))
        straight, leaning = (
            harmonics.standardize(5.0 + 3.0 * evaluate(layers, harmonics.directions.astype(np.float64)))
            for layers in (coefficients, turned(coefficients, R))
        )
        energies = [np.square(np.abs(harmonics.analyze(layers))) for layers in (straight, leaning)]
        for energy in energies:
            np.testing.assert_allclose(energy.sum(axis=(0, 2)), 4 * np.pi, rtol=1e-4)
            np.testing.assert_allclose(energy[0], 0, atol=1e-8)
        # a turn mixes the orders of a degree, and leaves its energy
        np.testing.assert_allclose(energies[0].sum(axis=2), energies[1].sum(axis=2), rtol=1e-3, atol=1e-6)
        assert np.isfinite(harmonics.standardize(np.full((1, 16, 40), 7.0, np.float32))).all()

    def test_finer_structure_is_not_taken_for_coarse(self):
        fine = random_coefficients(24, 2, seed=5)
        fine[:8] = 0  # nothing below degree 16
        harmonics = Harmonics(16, 24, 64)
        layers = evaluate(fine, harmonics.directions.astype(np.float64))
        assert np.abs(harmonics.analyze(layers)).max() < 1e-5 * np.abs(fine).max()

    def test_layers_do_not_mix(self):
        harmonics = Harmonics(8, 8, 16)
        layers = np.random.default_rng(6).normal(size=(5, 8, 16))
        together = harmonics.analyze(layers)
        for n in range(5):
            np.testing.assert_allclose(harmonics.analyze(layers[n : n + 1])[:, 0], together[:, n], atol=1e-6)

    def test_no_layers_have_no_coefficients(self):
        assert Harmonics(8, 8, 16).analyze(np.zeros((0, 8, 16))).shape == (4, 0, 15)

    @pytest.mark.parametrize("bad", [np.nan, np.inf])
    def test_refuses_what_is_not_finite(self, bad):
        layers = np.zeros((2, 8, 16), np.float32)
        layers[1, 3, 4] = bad
        with pytest.raises(InputError, match="`layers` hold numbers that are not finite"):
            Harmonics(8, 8, 16).analyze(layers)

    def test_refuses_other_layers(self):
        harmonics = Harmonics(8, 8, 16)
        for layers in (np.zeros((8, 16)), np.zeros((2, 16, 8)), np.zeros((2, 8, 16), np.complex64)):
            with pytest.raises(InputError, match="wanted real ones"):
                harmonics.analyze(layers)

    @pytest.mark.parametrize("numbers", [(0, 8, 16), (7, 8, 16), (8, 3, 16), (8, 8, 15)])
    def test_refuses_grids_that_do_not_fit(self, numbers):
        with pytest.raises(InputError, match=f"`bandwidth={numbers[0]}` with"):
            Harmonics(*numbers)


class TestEqualize:
    def test_power_0_leaves_all_but_degree_0(self):
        coefficients = random_coefficients(16, 5, seed=7).astype(np.complex64)
        got = equalize(coefficients, 0)
        assert relative(got[1:], coefficients[1:]) < 1e-5
        assert not got[0].any()
        assert got.dtype == np.complex64

    @pytest.mark.parametrize("power", [0.4, 1.0])
    @pytest.mark.parametrize("layers", [1, 4, 40])
    def test_each_degree_keeps_its_energy(self, power, layers):
        coefficients = random_coefficients(12, layers, seed=8, decay=2)
        got = equalize(coefficients, power)
        want = np.square(np.abs(coefficients)).sum(axis=(1, 2))
        np.testing.assert_allclose(np.square(np.abs(got)).sum(axis=(1, 2))[1:], want[1:], rtol=1e-5)

    def test_the_result_is_of_real_layers(self):
        got = equalize(random_coefficients(10, 3, seed=9), 0.5)
        orders = np.arange(-9, 10)
        np.testing.assert_allclose(got[..., ::-1], (-1.0) ** np.abs(orders) * got.conj(), atol=1e-6)

    @pytest.mark.parametrize("layers", [3, 30])
    @pytest.mark.parametrize("power", [0.3, 0.4, 1.0])
    def test_a_turned_scan_gives_the_turned_result(self, power, layers):
        coefficients = random_coefficients(8, layers, seed=10, decay=1)
        R = Rotation.from_euler("ZYX", [40, -25, 70], degrees=True)
        got = equalize(turned(coefficients, R), power)
        want = turned(equalize(coefficients, power).astype(np.complex128), R)
        assert relative(got, want) < 1e-4
        # which would hold for whatever leaves the coefficients alone
        assert relative(equalize(coefficients, power)[1:], coefficients[1:]) > 0.05

    def test_power_1_makes_the_directions_of_a_degree_alike(self):
        coefficients = random_coefficients(8, 60, seed=11)
        coefficients[2, :, 7 - 4 : 7 + 5] *= np.array([3, 2, 1, 4, 5, 4, 1, 2, 3])  # order by order
        whitened = equalize(coefficients, 1)[2, :, 3:12]
        gram = whitened.conj().T @ whitened
        np.testing.assert_allclose(gram / gram[0, 0].real, np.eye(9), atol=1e-3)

    def test_a_direction_that_is_mere_rounding_is_not_lifted(self):
        """Two layers span 2 of 9 directions; the others stay weaker than the bound lifts them."""
        coefficients = random_coefficients(8, 2, seed=12)
        got = equalize(coefficients, 1)[2, :, 3:12]
        assert np.linalg.svd(got, compute_uv=False).min() > 0.9 * np.linalg.norm(got) / np.sqrt(2)
        basis = np.linalg.svd(coefficients[2, :, 3:12])[2][2:]
        assert np.abs(got @ basis.conj().T).max() < 1e-4 * np.linalg.norm(got)

    @pytest.mark.parametrize("scale", [1e-25, 1e18])
    def test_the_scale_does_not_matter(self, scale):
        coefficients = random_coefficients(8, 6, seed=13)
        assert relative(equalize(coefficients * scale, 0.4) / scale, equalize(coefficients, 0.4)) < 1e-4

    def test_what_is_0_stays_0(self):
        coefficients = random_coefficients(8, 3, seed=14)
        coefficients[2] = 0
        got = equalize(coefficients, 0.4)
        assert not got[2].any()
        assert got[1].any()
        assert not equalize(np.zeros((4, 3, 15), np.complex64), 1).any()
        assert equalize(np.zeros((4, 0, 15), np.complex64), 1).shape == (4, 0, 15)

    def test_refuses_what_it_cannot_use(self):
        good = random_coefficients(8, 3, seed=15)
        for power in (-0.1, 1.1, np.nan):
            with pytest.raises(InputError, match="wanted 0 to 1"):
                equalize(good, power)
        with pytest.raises(InputError, match="wanted \\(degrees, L, 4 degrees - 1\\)"):
            equalize(good[1:], 0.4)
        good[1, 2, 7] = np.nan
        with pytest.raises(InputError, match="`coefficients` hold numbers that are not finite"):
            equalize(good, 0.4)
