"""Signatures of scans: invariance to rotation and translation, and distinction of places."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.prepare.spectral_scan import signature
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.scan import Scan
from tests.samples.scenes.sphere_layers import random_coefficients, turned
from tests.samples.scenes.structures import moved, structure

PLACES = 5


def coefficients(seed: int = 1) -> np.ndarray:
    return random_coefficients(10, 8, seed, decay=1.0).astype(np.complex64)


def products(given: np.ndarray) -> np.ndarray:
    """Products of the layers in float32, as from `Harmonics.products`."""
    exact = given.astype(np.complex128)
    return np.real(exact @ exact.conj().transpose(0, 2, 1)).astype(np.float32)


class TestSignature:
    @pytest.mark.parametrize("seed", range(2))
    def test_no_rotation_of_the_layers_changes_it(self, seed):
        R = Rotation.random(rng=np.random.default_rng(seed))
        given = coefficients(seed)
        rotated = turned(given.astype(np.complex128), R).astype(np.complex64)
        assert np.abs(rotated - given).max() > 0.1
        np.testing.assert_allclose(signature(products(rotated)), signature(products(given)), atol=1e-6)
        assert np.linalg.norm(signature(products(given)) - signature(products(coefficients(seed + 10)))) > 0.5

    def test_neither_does_the_loudness_of_a_layer_nor_its_mean(self):
        given = coefficients()
        other = given * np.array([3, 0.1, 20, 1, 1e-3, 5, 1, 9], np.float32)[:, None]
        other[0] += 7
        np.testing.assert_allclose(signature(products(other)), signature(products(given)), atol=1e-6)
        # a layer that holds nothing is zero
        given[:, 0] = 0
        per_degree = signature(products(given)).reshape(4, 10)
        assert not per_degree[:, :4].any()
        assert per_degree[:, 4:].any(axis=0).all()


@pytest.fixture(scope="module")
def registrar() -> SpectralRegistrar:
    return SpectralRegistrar(choose_device(), Grid(128, 0.25))


def of(registrar: SpectralRegistrar, points: np.ndarray) -> np.ndarray:
    return registrar.signature(registrar.prepare(Scan(points)))


def somewhere(rng: np.random.Generator) -> RigidTransform:
    return RigidTransform.from_components(rng.normal(size=3) * [7, -11, 4], Rotation.random(rng=rng))


@pytest.fixture(scope="module")
def places() -> list[np.ndarray]:
    rng = np.random.default_rng(11)
    return [moved(structure(seed), somewhere(rng)) for seed in range(PLACES)]


@pytest.fixture(scope="module")
def signatures(registrar, places) -> np.ndarray:
    return np.array([of(registrar, points) for points in places])


@pytest.fixture(scope="module")
def between(signatures) -> np.ndarray:
    distance = np.linalg.norm(signatures[:, None] - signatures, axis=2)
    return distance[np.triu_indices(PLACES, 1)]


@pytest.mark.slow
class TestOfScans:
    """On real voxels a rotation changes how surfaces lie in them, so that it is nearly the same only.

    Places differ by 0.79 (median; 0.57 at least), a place turned any way from itself by 0.18 (0.25 at most).
    """

    def test_it_is_the_same_again_and_a_translation_changes_nothing(self, registrar, places, signatures):
        assert signatures.dtype == np.float32
        assert signatures.shape == (PLACES, 23 * 21)
        assert np.abs(signatures).max() <= 1
        assert of(registrar, places[2]).tobytes() == signatures[2].tobytes()
        shifted = moved(places[0], RigidTransform.from_translation([3.25, -7.5, 12.0]))
        assert np.linalg.norm(of(registrar, shifted) - signatures[0]) < 0.05

    def test_any_rotation_and_translation_change_little(self, registrar, places, signatures, between):
        rng = np.random.default_rng(12)
        for points, own in zip(places, signatures, strict=True):
            for _ in range(3):
                changed = np.linalg.norm(of(registrar, moved(points, somewhere(rng))) - own)
                assert changed < 0.4 * np.median(between)
                assert changed < between.min()

    def test_with_noise_and_points_missing_a_place_is_still_nearest_to_itself(self, registrar, places, signatures):
        rng = np.random.default_rng(13)
        for number, points in enumerate(places):
            noisy = points + rng.normal(0, 0.1, points.shape).astype(np.float32)
            seen = noisy[rng.random(len(noisy)) > 0.3]
            got = of(registrar, moved(seen, somewhere(rng)))
            assert np.argmin(np.linalg.norm(signatures - got, axis=1)) == number
