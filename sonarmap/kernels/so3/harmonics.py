"""Spherical harmonics of a magnitude spectrum's layers, of even degrees only, as a layer is the same at d and -d.

A real layer f has f(d) = sum over l, m of a[l, m] Y[l, m](d), Y the orthonormal harmonics with the Condon-Shortley
phase (scipy.special.sph_harm_y). Latitudes are the Gauss-Legendre nodes of the upper hemisphere; the lower one
repeats it at the opposite points.
"""

from functools import partial
from typing import Any

import numpy as np
import pyopencl.array as cla
from scipy.special import sph_harm_y

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import launch, require_array, table
from sonarmap.kernels.errors import InputError

_RINGS_AT_ONCE = 16
_ORDERS_AT_ONCE = 4
_GROUP = 64  # work-items of a group on a GPU
_LEAST_ENERGY = 1e-3  # share of a degree's strongest direction; weaker directions are amplified as if they had it


class Harmonics:
    """Transform from a magnitude spectrum to the coefficients of its layers, planned once for a device.

    Attributes:
        bandwidth: degrees are even and below it.
        directions: (latitudes, longitudes, 3) float32, unit vectors of the samples, z > 0.
    """

    def __init__(self, device: Device, bandwidth: int, latitudes: int, longitudes: int) -> None:
        """Tabulate the associated Legendre functions, and the cosines and sines along a circle.

        Args:
            bandwidth: a multiple of 8.
            latitudes: number in the upper hemisphere, a multiple of 16, at least half the bandwidth; more of them
                reduce the aliasing of finer structure.
            longitudes: their number, a multiple of 4, at least twice the bandwidth.
        """
        fits = 2 * latitudes >= bandwidth and longitudes >= 2 * bandwidth
        if bandwidth < 8 or bandwidth % 8 or latitudes % _RINGS_AT_ONCE or longitudes % 4 or not fits:
            raise InputError(
                f"`bandwidth={bandwidth}` with {latitudes} x {longitudes} samples; wanted a multiple of 8, a multiple "
                "of 16 that is at least half of it, and a multiple of 4 that is at least twice as large"
            )
        self.device, self.bandwidth = device, bandwidth
        self._shape = latitudes, longitudes
        self._launch = partial(launch, device, BANDWIDTH=bandwidth)
        nodes, weights = np.polynomial.legendre.leggauss(2 * latitudes)
        height, weights = nodes[latitudes:], weights[latitudes:]
        across = np.sqrt(1 - height**2)
        longitude = np.arange(longitudes) * (2 * np.pi / longitudes)
        circle = np.column_stack([np.cos(longitude), np.sin(longitude)])
        upward = np.broadcast_to(height[:, None, None], (latitudes, longitudes, 1))
        self.directions = np.concatenate([across[:, None, None] * circle, upward], axis=2).astype(np.float32)
        tables = np.stack([across, height]), circle, weights / weights.sum(), self._turns(longitude)
        self._rings, self._circle, self._weights, self._turned = (
            device.to_device(values.astype(np.float32)) for values in tables
        )
        # times 2 for the lower hemisphere
        self._legendre = device.to_device(self._orders(np.arccos(height), 4 * np.pi / longitudes * weights))

    def _orders(self, polar: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Y[l, m] at longitude 0 times its node's weight, for l >= m >= 0, float32 in the layout of harmonics.cl."""
        values = np.zeros((self.bandwidth, self.bandwidth // 2, len(polar)), np.float32)
        for order in range(self.bandwidth):
            degrees = np.arange(order + order % 2, self.bandwidth, 2)
            exact = np.real(sph_harm_y(degrees[:, None], order, polar[None, :], 0.0))
            values[order, degrees // 2] = exact * weights
        return values if self.device.is_cpu else np.ascontiguousarray(values.transpose(1, 2, 0))

    def _turns(self, longitude: np.ndarray) -> np.ndarray:
        """Cosines and sines of order times longitude on a quarter circle, in the layout of harmonics.cl."""
        angles = np.outer(longitude[: len(longitude) // 4 + 1], np.arange(self.bandwidth))
        if not self.device.is_cpu:
            return np.stack([np.cos(angles), np.sin(angles)])
        pairs = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        blocks = pairs.reshape(len(angles), -1, _ORDERS_AT_ONCE, 2, 2)  # the even and the odd order of each pair
        return blocks.transpose(3, 1, 0, 2, 4)

    def analyze(self, magnitude: cla.Array, radii: np.ndarray) -> cla.Array:
        """Coefficients of the layers at these radii, each normalized to mean 0 and variance 1 over the sphere.

        Mean and variance use the weights of the quadrature, because a ring near the pole has as many samples as one at
        the equator but covers less of the sphere; otherwise they would change with a rotation.

        Args:
            magnitude: (edge, edge, edge/2 + 1) float32, as `spectrum.magnitude` gives it.
            radii: (L,), in [0, edge/2 - 1) [frequency bins].

        Returns:
            device (bandwidth / 2, L, 2 bandwidth - 1) complex64: [l / 2, layer, m + bandwidth - 1] is a[l, m], 0 for
            |m| > l and for a constant layer.
        """
        edge = magnitude.shape[0]
        require_array(magnitude, "magnitude", (edge, edge, edge // 2 + 1))
        radii = np.asarray(radii, np.float32)
        if radii.ndim != 1 or not len(radii) or not (radii.min() >= 0 and radii.max() < edge / 2 - 1):
            raise InputError(f"`radii` are {radii}; wanted a list of numbers from 0 to below {edge // 2 - 1} bins")
        layers, latitudes, device = len(radii), self._shape[0], self.device
        waves, moments = device.empty((layers, latitudes, self.bandwidth, 2)), device.empty((2, layers, latitudes))
        result = device.empty((self.bandwidth // 2, layers, 2 * self.bandwidth - 1), np.complex64)
        tables = self._rings, self._circle, table(device, radii), self._turned
        cpu = device.is_cpu
        size = (latitudes // _RINGS_AT_ONCE if cpu else _GROUP * latitudes, layers)
        group = None if cpu else (_GROUP, 1)
        sizes: dict[str, Any] = {"EDGE": edge, "LATITUDES": latitudes, "LONGITUDES": self._shape[1]}
        self._launch("so3/harmonics", "waves", size, magnitude, *tables, waves, moments, group=group, **sizes)
        size = (self.bandwidth, layers) if cpu else (self.bandwidth, layers, self.bandwidth // 2)
        arrays = waves, moments, self._weights, self._legendre, result
        self._launch("so3/harmonics", "project", size, *arrays, **sizes)
        return result

    def products(self, coefficients: cla.Array) -> cla.Array:
        """Real parts of the inner products of any two layers' coefficients, (degrees, L, orders) from `analyze`, degree
        by degree: device (degrees, L, L) float32."""
        layers = self._layers(coefficients)
        result = self.device.empty((self.bandwidth // 2, layers, layers))
        across = layers if self.device.is_cpu else -(-layers // 32) * 32
        size, group = (across, layers, self.bandwidth // 2), (across if self.device.is_cpu else 32, 1, 1)
        self._launch("so3/mixtures", "products", size, coefficients, result, np.int32(layers), group=group)
        return result

    def mix(self, coefficients: cla.Array, mixtures: np.ndarray) -> cla.Array:
        """Sums of coefficients (degrees, L, orders), weighted by mixtures (degrees, K, L): device (degrees, K, orders)
        complex64."""
        layers, (degrees, sums, _) = self._layers(coefficients), mixtures.shape
        if mixtures.shape != (self.bandwidth // 2, sums, layers):
            raise InputError(f"`mixtures` have shape {mixtures.shape}; wanted ({self.bandwidth // 2}, K, {layers})")
        result = self.device.empty((degrees, sums, 2 * self.bandwidth - 1), np.complex64)
        numbers = 2 * (2 * self.bandwidth - 1)
        cpu = self.device.is_cpu
        size = (-(-numbers // 16) if cpu else -(-numbers // 32) * 32, sums, degrees)
        arrays = coefficients, self.device.to_device(mixtures.astype(np.float32)), result
        group = (size[0] if cpu else 32, 1, 1)
        self._launch("so3/mixtures", "mix_layers", size, *arrays, np.int32(layers), group=group)
        return result

    def _layers(self, coefficients: cla.Array) -> int:
        shape = self.bandwidth // 2, None, 2 * self.bandwidth - 1
        return require_array(coefficients, "coefficients", shape, np.complex64)[1]


def equalizers(products: np.ndarray, power: float) -> np.ndarray:
    """Mixtures of layers that equalize the energies of directions within each degree: a partial phase-only filter.

    Phase-only matched filtering divides each frequency by its magnitude. On the sphere the frequencies of degree l mix
    under a rotation; the matrix of the products between its 2 l + 1 orders, summed over the layers, takes the place of
    the magnitude. The matrix G of the products between the layers has the same nonzero eigenvalues, so mixing layers by
    G^(-power / 2) has the same effect. A rotation of the scan rotates the result. Each degree keeps its energy;
    degree 0, which no rotation changes, becomes 0.

    Args:
        products: (degrees, L, L), from `Harmonics.products`.
        power: 0..1; 0 leaves all degrees but 0 unchanged, 1 is phase-only, which amplifies noise.

    Returns:
        (degrees, L, L) float64, for `Harmonics.mix`.
    """
    if not 0 <= power <= 1:
        raise InputError(f"`power={power}`; wanted 0 to 1")
    if products.ndim != 3 or products.shape[1] != products.shape[2]:
        raise InputError(f"`products` have shape {products.shape}; wanted (degrees, L, L)")
    if not np.isfinite(products).all():
        raise InputError("`products` have values that are not finite; check the input volume")
    values, vectors = np.linalg.eigh(products.astype(np.float64))
    values = np.maximum(values, 0)
    largest = np.maximum(values.max(axis=1, initial=0, keepdims=True), np.finfo(np.float64).tiny)
    scales = np.maximum(values / largest, _LEAST_ENERGY) ** (-power / 2)
    energy, scaled = values.sum(axis=1), (values * scales**2).sum(axis=1)
    scales *= np.sqrt(energy / np.where(scaled > 0, scaled, 1.0))[:, None]
    scales[:1] = 0
    return (vectors * scales[:, None]) @ vectors.transpose(0, 2, 1)
