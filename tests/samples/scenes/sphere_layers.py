"""Band-limited layers on the sphere for tests: random coefficients of real layers, and their values anywhere."""

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y


def random_coefficients(bandwidth: int, layers: int, seed: int, decay: float = 0.0) -> np.ndarray:
    """(bandwidth / 2, layers, 2 bandwidth - 1) complex128 as `Harmonics.analyze` has them, of real layers, whose higher
    degrees are weaker by (1 + l)^-decay."""
    rng = np.random.default_rng([seed, bandwidth, layers])
    result = np.zeros((bandwidth // 2, layers, 2 * bandwidth - 1), np.complex128)
    for half in range(bandwidth // 2):
        for order in range(2 * half + 1):
            values = rng.normal(size=(layers, 2)) @ [1, 1j] * (1.0 + 2 * half) ** -decay
            result[half, :, bandwidth - 1 - order] = (-1) ** order * values.conj()
            result[half, :, bandwidth - 1 + order] = values if order else values.real
    return result


def evaluate(coefficients: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The layers' values (layers, ...) at directions (..., 3), by the sum of the harmonics."""
    bandwidth = 2 * len(coefficients)
    polar = np.arccos(np.clip(directions[..., 2], -1, 1))
    azimuth = np.arctan2(directions[..., 1], directions[..., 0])
    values = np.zeros((coefficients.shape[1], *polar.shape))
    for half in range(len(coefficients)):
        for order in range(-2 * half, 2 * half + 1):
            harmonic = sph_harm_y(2 * half, order, polar, azimuth)
            values += np.real(np.multiply.outer(coefficients[half, :, order + bandwidth - 1], harmonic))
    return values


def turned(coefficients: np.ndarray, R: Rotation) -> np.ndarray:
    """The coefficients of g(d) = f(R d), by quadrature of the values there: no D-matrix takes part."""
    bandwidth = 2 * len(coefficients)
    heights, weights = np.polynomial.legendre.leggauss(bandwidth)
    azimuths = np.arange(2 * bandwidth) * (np.pi / bandwidth)
    across = np.sqrt(1 - heights**2)[:, None]
    up = np.broadcast_to(heights[:, None], (len(heights), len(azimuths)))
    directions = np.stack([across * np.cos(azimuths), across * np.sin(azimuths), up], axis=-1)
    values = evaluate(coefficients, R.apply(directions.reshape(-1, 3)).reshape(directions.shape))
    scaled = values * (weights[:, None] * np.pi / bandwidth)
    result = np.zeros_like(coefficients)
    for half in range(len(coefficients)):
        for order in range(-2 * half, 2 * half + 1):
            harmonic = sph_harm_y(2 * half, order, np.arccos(heights)[:, None], azimuths[None, :])
            result[half, :, order + bandwidth - 1] = (scaled * harmonic.conj()).sum(axis=(1, 2))
    return result
