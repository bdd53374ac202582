"""Spherical harmonics of layers that are the same at d and -d, as a magnitude spectrum's are: even degrees only.

A real layer f has f(d) = sum over l, m of a[l, m] Y[l, m](d), Y the orthonormal harmonics with the Condon-Shortley
phase (scipy.special.sph_harm_y). Latitudes are the Gauss-Legendre nodes of the upper hemisphere; the lower one says the
same at the opposite places. The transform runs on the host: it is a few million multiplications, once a scan.
"""

import numpy as np
import scipy.fft
from scipy.special import sph_harm_y

from kernels.errors import InputError

# What is weaker than the strongest direction of a degree by this factor, in energy, is not lifted further.
_FAINTEST = 1e-3


class Harmonics:
    """The transform from layers on a grid of latitudes and longitudes to coefficients, planned once.

    Attributes:
        bandwidth: degrees are even and below it.
        directions: (latitudes, longitudes, 3) float32, unit vectors of the samples, z > 0.
    """

    def __init__(self, bandwidth: int, latitudes: int, longitudes: int) -> None:
        """Tabulate the associated Legendre functions.

        Args:
            bandwidth: even, at least 2.
            latitudes: of the upper hemisphere; at least half the bandwidth, more where layers hold finer structure,
                which would otherwise alias into coarse structure.
            longitudes: at least twice the bandwidth. `sphere.upload_directions` takes the directions where the product
                with the latitudes is a multiple of 8.

        Raises:
            InputError: the numbers do not fit each other.
        """
        if bandwidth < 2 or bandwidth % 2 or 2 * latitudes < bandwidth or longitudes < 2 * bandwidth:
            raise InputError(
                f"`bandwidth={bandwidth}` with {latitudes} x {longitudes} samples; wanted an even bandwidth, at least "
                "half as many latitudes and twice as many longitudes"
            )
        self.bandwidth = bandwidth
        nodes, weights = np.polynomial.legendre.leggauss(2 * latitudes)
        height, self._weights = nodes[latitudes:], weights[latitudes:]
        longitude = np.arange(longitudes) * (2 * np.pi / longitudes)
        across = np.sqrt(1 - height**2)[:, None]
        up = np.broadcast_to(height[:, None], (latitudes, longitudes))
        directions = np.stack([across * np.cos(longitude), across * np.sin(longitude), up], axis=-1)
        self.directions = directions.astype(np.float32)
        # twice, for the lower hemisphere
        self._legendre = [self._order(m, np.arccos(height), 2 * 2 * np.pi / longitudes) for m in range(bandwidth)]

    def _order(self, order: int, polar: np.ndarray, scale: float) -> np.ndarray:
        """(degrees, latitudes) float32: Y[l, order] at longitude 0 times the weight of its node, for l >= order."""
        degrees = np.arange(order + order % 2, self.bandwidth, 2)
        values = np.real(sph_harm_y(degrees[:, None], order, polar[None, :], 0.0))
        return (values * self._weights * scale).astype(np.float32)

    def standardize(self, layers: np.ndarray) -> np.ndarray:
        """Layers (L, latitudes, longitudes) of mean 0 and variance 1 over the sphere: by the quadrature's weights.

        Rows near the pole hold as many samples as rows near the equator, of less of the sphere: a plain mean would
        change with a rotation. A layer without a variance becomes 0.
        """
        weights = (self._weights / self._weights.sum()).astype(np.float32)
        centered = layers - (layers.mean(axis=2) @ weights)[:, None, None]
        variance = np.square(centered).mean(axis=2) @ weights
        return centered / np.sqrt(np.maximum(variance, np.float32(1e-30)))[:, None, None]

    def analyze(self, layers: np.ndarray) -> np.ndarray:
        """The coefficients of real layers (L, latitudes, longitudes), each its own.

        Returns:
            (bandwidth / 2, L, 2 bandwidth - 1) complex64: [l / 2, layer, m + bandwidth - 1] is a[l, m], 0 for |m| > l.

        Raises:
            InputError: the layers have another shape, or hold what is not a finite number.
        """
        grid = self.directions.shape[:2]
        if layers.ndim != 3 or layers.shape[1:] != grid or np.iscomplexobj(layers):
            raise InputError(
                f"`layers` are {layers.dtype} of shape {layers.shape}; wanted real ones of (L, {grid[0]}, {grid[1]})"
            )
        layers = layers.astype(np.float32, copy=False)
        _require_finite(layers, "layers")
        waves = np.asarray(scipy.fft.rfft(layers, axis=2))[:, :, : self.bandwidth]
        middle = self.bandwidth - 1
        result = np.zeros((self.bandwidth // 2, len(layers), 2 * self.bandwidth - 1), np.complex64)
        for order, legendre in enumerate(self._legendre):
            positive = legendre @ waves[:, :, order].T  # (degrees, L)
            first = self.bandwidth // 2 - len(legendre)
            result[first:, :, middle + order] = positive
            if order:
                result[first:, :, middle - order] = (-1) ** order * positive.conj()
        return result


def equalize(coefficients: np.ndarray, power: float) -> np.ndarray:
    """Coefficients whose directions within each degree count more alike: a half-way phase-only filter on the sphere.

    Phase-only matched filtering divides each frequency by its magnitude. On the sphere the frequencies of degree l mix
    under a rotation; what takes the place of the magnitude is the matrix G of the products between its 2 l + 1 orders,
    summed over the layers, and G^(-power / 2) of both scans makes the correlation's matrix a power of 1 - power. A
    rotation of the scan rotates the result, as it does the coefficients. Each degree keeps its energy; degree 0, which
    no rotation changes, is set to 0.

    Args:
        coefficients: (degrees, L, orders) complex64, of real layers, from `Harmonics.analyze`.
        power: 0..1; 0 leaves all degrees but 0 as they are, 1 is phase only, which lifts what is mere noise.

    Returns:
        (degrees, L, orders) complex64.

    Raises:
        InputError: the power is another, or the coefficients have another shape or are not finite.
    """
    if not 0 <= power <= 1:
        raise InputError(f"`power={power}`; wanted 0 to 1")
    if coefficients.ndim != 3 or coefficients.shape[2] != 4 * coefficients.shape[0] - 1:
        raise InputError(f"`coefficients` have shape {coefficients.shape}; wanted (degrees, L, 4 degrees - 1)")
    _require_finite(coefficients, "coefficients")
    result = np.zeros(coefficients.shape, np.complex64)
    middle = coefficients.shape[2] // 2
    for half in range(1, len(coefficients)):
        degree = 2 * half
        whole = _to_real(coefficients[half, :, middle : middle + degree + 1])
        positive = _to_complex(_equalize_degree(whole, power))
        result[half, :, middle : middle + degree + 1] = positive
        signs = (-1.0) ** np.arange(degree, 0, -1)
        result[half, :, middle - degree : middle] = signs * positive[:, :0:-1].conj()
    return result


def _equalize_degree(part: np.ndarray, power: float) -> np.ndarray:
    """Layers (L, 2 l + 1) float32 in the real harmonics of one degree, times G^(-power / 2), of the same energy."""
    largest = np.abs(part).max(initial=0)
    if not largest > 0:
        return part
    part = part / largest  # squares of tiny numbers would be 0
    # the smaller of both products has the same eigenvalues, less zeros that meet nothing
    few = len(part) < part.shape[1]
    values, vectors = np.linalg.eigh(part @ part.T if few else part.T @ part)
    scale = np.maximum(values / values[-1], _FAINTEST) ** (-power / 2)
    turn = (vectors * scale) @ vectors.T
    turned = turn @ part if few else part @ turn
    return turned * (largest * np.linalg.norm(part) / np.linalg.norm(turned))


def _to_real(positive: np.ndarray) -> np.ndarray:
    """(L, 2 l + 1) float32 from the orders 0..l: the same layers in the real harmonics, cosines, then sines.

    The two bases are unitarily alike, and real matrices are quicker.
    """
    scaled = np.sqrt(2) * positive[:, 1:]
    parts = [np.real(positive[:, :1]), np.real(scaled), np.imag(scaled)]
    return np.concatenate(parts, axis=1).astype(np.float32, copy=False)


def _to_complex(part: np.ndarray) -> np.ndarray:
    """(L, l + 1) complex64, the orders 0..l: the way back."""
    degree = part.shape[1] // 2
    positive = part[:, : degree + 1].astype(np.complex64)
    positive[:, 1:] += np.complex64(1j) * part[:, degree + 1 :]
    positive[:, 1:] *= np.float32(np.sqrt(0.5))
    return positive


def _require_finite(values: np.ndarray, what: str) -> None:
    if not np.isfinite(values).all():
        raise InputError(f"`{what}` hold numbers that are not finite; look at the volumes that went in")
