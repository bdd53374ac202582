"""Two functions on the sphere, correlated over all rotations by a fast Fourier transform on SO(3).

The correlation over R = Rz(alpha) Ry(beta) Rz(gamma) of f and g(d) = f(R d) is

    C(R) = sum over l, m, n of M[l, m, n] d[l, m, n](beta) exp(i (m alpha + n gamma)),
    M[l, m, n] = sum over the layers of a[l, m] conj(b[l, n]),

with a and b the coefficients of f and g and d Wigner's small d-matrices: P. J. Kostelec and D. N. Rockmore, "FFTs on
the rotation group", J. Fourier Anal. Appl. 14 (2008), DOI 10.1007/s00041-008-9013-5; for registration H. Buelow and
A. Birk, "Scale-free registrations in 3D", Int. J. Comput. Vis. 126 (2018), DOI 10.1007/s11263-018-1071-4.
"""

import numpy as np
import pyopencl.array as cla
from scipy.spatial.transform import Rotation

from kernels.device.device import Device
from kernels.device.launch import launch
from kernels.errors import InputError
from kernels.fft.transform import RealFFT


class RotationCorrelation:
    """Correlations over the rotations whose z axes are at most `largest` apart, on one device.

    Attributes:
        bandwidth: degrees are even and below it.
        betas: (n,) float64 [rad], the second Euler angles that are sampled, evenly from half a step on.
        edge: samples of the first and of the third Euler angle, over the full circle.
    """

    def __init__(self, device: Device, bandwidth: int, largest: float = np.pi) -> None:
        """Tabulate Wigner's d-matrices and plan the transform.

        Args:
            bandwidth: a multiple of 8 up to 256; memory grows with its fourth power.
            largest: [rad], up to pi; time and memory are in proportion.

        Raises:
            InputError: the bandwidth or the angle is another.
            DeviceError: the device cannot hold the tables.
        """
        if bandwidth < 8 or bandwidth % 8 or bandwidth > 256 or not 0 < largest <= np.pi:
            raise InputError(
                f"`bandwidth={bandwidth}`, `largest` {np.rad2deg(largest):g} degrees; wanted a multiple of 8 up to "
                "256, and above 0 up to 180 degrees"
            )
        self.device, self.bandwidth = device, bandwidth
        self._step = np.pi / (2 * bandwidth)
        count = min(int(np.ceil(largest / self._step - 0.5)) + 1, 2 * bandwidth)
        self.betas = (np.arange(count) + 0.5) * self._step
        self.edge = 1 << (2 * bandwidth - 1).bit_length()
        size = 4 * (bandwidth // 2) * count * (2 * bandwidth - 1) * bandwidth
        device.require(size, total=size, hint="a smaller `bandwidth`")
        self._wigner = device.to_device(_half_wigner(bandwidth, self.betas))
        self._given: list[cla.Array] = []
        self._products = device.empty((2 * bandwidth - 1, bandwidth // 8, bandwidth // 2, 8), np.complex64)
        # an image of zeros beyond the last keeps the cyclic search for peaks from joining the first to the last
        self._fft = RealFFT(device, (count + 1, self.edge, self.edge), batched=True)
        self._spectrum = device.empty(self._fft.half_shape, np.complex64)
        self._correlation = device.empty(self._fft.shape)

    def correlate(self, target: np.ndarray, source: np.ndarray) -> cla.Array:
        """C(R), for coefficients (bandwidth / 2, L, 2 bandwidth - 1) of `Harmonics.analyze`, or equalized.

        Where the layers of the source are those of the target turned, g(d) = f(R d), C is highest at R.

        Returns:
            device (betas + 1, edge, edge) float32: [b, i, j] is the rotation `rotations((b, i, j))`, the last image
            zeros. It is used again by the next call.

        Raises:
            InputError: the coefficients have other shapes, or are not finite.
        """
        layers = target.shape[1] if target.ndim == 3 else 0
        wanted = (self.bandwidth // 2, max(layers, 1), 2 * self.bandwidth - 1)
        if target.shape != wanted or source.shape != wanted:
            raise InputError(
                f"`target` and `source` have shapes {target.shape} and {source.shape}; wanted {wanted} for both"
            )
        if not (np.isfinite(target).all() and np.isfinite(source).all()):
            raise InputError("`target` or `source` holds numbers that are not finite; look at the layers that went in")
        self._multiply(target, source)
        size = (len(self.betas) + 1, self.edge)
        arrays = self._wigner, self._products, self._spectrum
        self._launch("synthesize", size, *arrays, np.int32(len(self.betas)))
        return self._fft.inverse(self._spectrum, out=self._correlation)

    def _multiply(self, target: np.ndarray, source: np.ndarray) -> None:
        """M, times what the inverse transform divides by, to the device; on the host its many threads would get in
        the way of the device's."""
        if not self._given or self._given[0].shape != target.shape:
            self._given = [self.device.empty(target.shape, np.complex64) for _ in range(2)]
        for array, coefficients in zip(self._given, (target, source), strict=True):
            array.set(np.ascontiguousarray(coefficients, np.complex64))
        layers, gain = np.int32(target.shape[1]), np.float32(self.edge**2)
        size = (2 * self.bandwidth - 1, self.bandwidth // 2)
        self._launch("multiply", size, *self._given, self._products, layers, gain)

    def _launch(self, kernel: str, size: tuple[int, int], *arguments: cla.Array | np.generic) -> None:
        launch(self.device, "so3/correlation", kernel, size, *arguments, BANDWIDTH=self.bandwidth, EDGE=self.edge)

    def rotations(self, index: np.ndarray) -> Rotation:
        """The rotations at places (..., 3) of the correlation, between samples too."""
        index = np.asarray(index, np.float64)
        turn = 2 * np.pi / self.edge
        angles = np.stack([index[..., 1] * turn, (index[..., 0] + 0.5) * self._step, index[..., 2] * turn], axis=-1)
        return Rotation.from_euler("ZYZ", angles)

    def places(self, R: Rotation) -> np.ndarray:
        """(n, 3) places of n rotations in the correlation, between samples: the inverse of `rotations`.

        The first is at least 0; where it would be less, near a turn about z alone, the other two act as their sum.
        """
        turn = 2 * np.pi / self.edge
        matrices = R.as_matrix()
        along = np.hypot(matrices[:, 0, 2], matrices[:, 1, 2])
        second = np.arctan2(along, matrices[:, 2, 2])
        upright = along < 1e-6
        first = np.where(
            upright, np.arctan2(-matrices[:, 0, 1], matrices[:, 1, 1]), np.arctan2(*matrices[:, 1::-1, 2].T)
        )
        third = np.where(upright, 0.0, np.arctan2(matrices[:, 2, 1], -matrices[:, 2, 0]))
        return np.column_stack(
            [
                np.clip(second / self._step - 0.5, 0, len(self.betas) - 1),
                first / turn % self.edge,
                third / turn % self.edge,
            ]
        )


def wigner_d(degree: int, betas: np.ndarray) -> np.ndarray:
    """Wigner's small d-matrices d[m, n](beta) = <l m| exp(-i beta J_y) |l n>.

    By the eigenvectors of J_y, whose eigenvalues are the whole numbers -l..l: stable for every degree.

    Args:
        degree: l.
        betas: (k,) [rad].

    Returns:
        (k, 2 l + 1, 2 l + 1) float64, m and n from -l on.
    """
    orders = np.arange(-degree, degree + 1)
    raising = np.diag(np.sqrt(degree * (degree + 1) - orders[:-1] * (orders[:-1] + 1.0)), -1)
    _, vectors = np.linalg.eigh((raising - raising.T) / 2j)
    phases = np.exp(-1j * np.asarray(betas)[:, None] * orders)
    return np.real((vectors * phases[:, None, :]) @ vectors.conj().T)


def _half_wigner(bandwidth: int, betas: np.ndarray) -> np.ndarray:
    """(orders, betas, bandwidth / 8, degrees, 8) float32, as correlation.cl reads it."""
    table = np.zeros((2 * bandwidth - 1, len(betas), bandwidth // 8, bandwidth // 2, 8), np.float32)
    for half in range(bandwidth // 2):
        degree = 2 * half
        blocks = degree // 8 + 1
        matrices = np.zeros((len(betas), 2 * degree + 1, 8 * blocks), np.float32)
        matrices[:, :, : degree + 1] = wigner_d(degree, betas)[:, :, degree:]
        orders = slice(bandwidth - 1 - degree, bandwidth + degree)
        table[orders, :, :blocks, half] = matrices.reshape(len(betas), -1, blocks, 8).swapaxes(0, 1)
    return table
