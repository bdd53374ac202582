"""Correlation of two functions on the sphere over all rotations, by a fast Fourier transform on SO(3).

The correlation over R = Rz(alpha) Ry(beta) Rz(gamma) of f and g(d) = f(R d) is

    C(R) = sum over l, m, n of M[l, m, n] d[l, m, n](beta) exp(i (m alpha + n gamma)),
    M[l, m, n] = sum over the layers of a[l, m] conj(b[l, n]),

with a and b the coefficients of f and g and d Wigner's small d-matrices: P. J. Kostelec and D. N. Rockmore, "FFTs on
the rotation group", J. Fourier Anal. Appl. 14 (2008), DOI 10.1007/s00041-008-9013-5; for registration H. Buelow and
A. Birk, "Scale-free registrations in 3D", Int. J. Comput. Vis. 126 (2018), DOI 10.1007/s11263-018-1071-4.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pyopencl.array as cla
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import launch, require_array, table, zero
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import row_pitch
from sonarmap.kernels.fft.transform import RealFFT

_GROUP = 32  # work-items of a group on a GPU
_FIRST_PEAKS = 256  # peaks of a part in the first read; a correlation of two scans has about ten, noise a hundred


@dataclass(frozen=True, slots=True)
class LocalMaxima:
    """Local maxima of one correlation, highest first."""

    index: np.ndarray  # (n, 3) int64, indices of the second, first, third Euler angle
    around: np.ndarray  # (n, 27) float32, values of the 3 x 3 x 3 neighborhood in C order

    @classmethod
    def sorted(cls, rows: np.ndarray) -> "LocalMaxima":
        """Local maxima from rows (n, 32) of peaks.cl, in any order."""
        index = rows[:, 1:4].astype(np.int64)
        order = np.lexsort((index[:, 2], index[:, 1], index[:, 0], -rows[:, 0]))
        return cls(index[order], rows[order, 4:31])


class _Plan:
    """Buffers and transform for a number of parts, reused by later calls."""

    def __init__(self, device: Device, bandwidth: int, shape: tuple[int, int, int]) -> None:
        parts, images, edge = shape
        self.products = device.empty((parts, 2 * bandwidth - 1, bandwidth, bandwidth // 2), np.complex64)
        # an image of zeros after the last one keeps the cyclic search for peaks from joining the last to the first
        self.fft = RealFFT(device, (parts * images, edge, edge), batched=True)
        self.spectrum = device.empty(self.fft.half_shape, np.complex64)
        self.correlation = device.empty(self.fft.shape)
        self.peaks = device.empty((1 + 4 * edge * (images - 1), parts, 32))


class RotationCorrelation:
    """Correlations over the rotations that tilt the z axis by at most `largest`, on one device.

    Attributes:
        bandwidth: degrees are even and below it.
        betas: (n,) float64 [rad], samples of the second Euler angle, evenly from half a step on.
        edge: number of samples of the first and of the third Euler angle, over the full circle.
    """

    def __init__(self, device: Device, bandwidth: int, largest: float = np.pi) -> None:
        """Tabulate Wigner's d-matrices. `bandwidth` is a multiple of 8 up to 256; memory grows with its fourth power.
        `largest` [rad] is the largest tilt; time and memory grow in proportion to it."""
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
        tabulated = _half_wigner(bandwidth, self.betas)
        if not device.is_cpu:
            tabulated = tabulated.transpose(0, 1, 3, 2, 4)
        self._wigner = device.to_device(tabulated)
        self._plans: dict[int, _Plan] = {}
        self._group = None if device.is_cpu else (_GROUP, 1, 1)
        self._launch = partial(launch, device, "so3/correlation", EDGE=self.edge, BANDWIDTH=bandwidth)

    def correlate(
        self, target: cla.Array, source: cla.Array, parts: Sequence[tuple[int, int]] | None = None
    ) -> cla.Array:
        """C(R) of each part of the layers, from `Harmonics` coefficients (bandwidth / 2, L, 2 bandwidth - 1).

        If the layers of the source are those of the target rotated, g(d) = f(R d), C is highest at R.

        Args:
            parts: first layer and number of layers of each part; None: one part of all layers.

        Returns:
            device (parts, betas + 1, edge, edge) float32: [p, b, i, j] is the rotation `rotations((b, i, j))`; the last
            image is 0. The next call with the same number of parts overwrites it.
        """
        wanted = (self.bandwidth // 2, None, 2 * self.bandwidth - 1)
        _, layers, _ = require_array(target, "target", wanted, np.complex64)
        require_array(source, "source", (wanted[0], layers, wanted[2]), np.complex64)
        ranges = np.array([(0, layers)] if parts is None else parts, np.int32)
        if ranges.ndim != 2 or ranges.min(initial=0) < 0 or ranges.sum(axis=1).max() > layers:
            raise InputError(f"`parts={parts}` go beyond the {layers} layers; give first layer and number of each")
        plan = self._plan(len(ranges))
        orders, degrees, cpu = 2 * self.bandwidth - 1, self.bandwidth // 2, self.device.is_cpu
        arrays = target, source, table(self.device, ranges), plan.products
        # the gain undoes the division by the inverse transform
        numbers = np.int32(layers), np.float32(self.edge**2)
        size = (orders, degrees, len(ranges)) if cpu else (_padded(self.bandwidth), orders, degrees * len(ranges))
        self._launch("multiply", size, *arrays, *numbers, group=self._group, PARTS=len(ranges))
        images = len(self.betas) + 1
        size = (images, self.edge) if cpu else (_padded(row_pitch(self.edge)), self.edge, images)
        arrays = self._wigner, plan.products, plan.spectrum
        arguments = *arrays, np.int32(len(self.betas))
        self._launch("synthesize", size, *arguments, group=self._group, PARTS=len(ranges))
        correlation = plan.fft.inverse(plan.spectrum, out=plan.correlation)
        return correlation.reshape(len(ranges), images, self.edge, self.edge)

    def peaks(self, correlation: cla.Array) -> list[LocalMaxima]:
        """The local maxima of each part of a correlation, highest first, at most one in each quarter of a row; equal
        values are ordered by voxel. Blocks for one read, or for two if a part has many maxima."""
        parts, images = len(correlation), len(self.betas) + 1
        require_array(correlation, "correlation", (parts, images, self.edge, self.edge))
        plan = self._plan(parts)
        zero(self.device, plan.peaks[:1])
        cpu = self.device.is_cpu
        size = (images - 1, parts) if cpu else (self.edge**2, images - 1, parts)
        group = None if cpu else (self.edge // 4, 1, 1)
        arguments = correlation, plan.peaks, np.int32(images)
        self._launch("local_maxima", size, *arguments, group=group, PARTS=parts)
        rows = plan.peaks[: 1 + _FIRST_PEAKS].get()
        counts = rows[0, :, 0].view(np.int32)
        if counts.max() > _FIRST_PEAKS:
            rows = plan.peaks[: 1 + int(counts.max())].get()
        return [LocalMaxima.sorted(rows[1 : 1 + count, part]) for part, count in enumerate(counts)]

    def _plan(self, parts: int) -> "_Plan":
        if parts not in self._plans:
            self._plans[parts] = _Plan(self.device, self.bandwidth, (parts, len(self.betas) + 1, self.edge))
        return self._plans[parts]

    def rotations(self, index: np.ndarray) -> Rotation:
        """The rotations at indices (..., 3) of the correlation, which may be fractional."""
        index = np.asarray(index, np.float64)
        turn = 2 * np.pi / self.edge
        angles = np.stack([index[..., 1] * turn, (index[..., 0] + 0.5) * self._step, index[..., 2] * turn], axis=-1)
        return Rotation.from_euler("ZYZ", angles)

    def places(self, R: Rotation) -> np.ndarray:
        """Fractional indices (n, 3) of n rotations in the correlation: the inverse of `rotations`. The first is clipped
        to the sampled range; near a rotation about z alone only the sum of the other two matters."""
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


def _padded(count: int) -> int:
    return -(-count // _GROUP) * _GROUP


def wigner_d(degree: int, betas: np.ndarray) -> np.ndarray:
    """Wigner's d-matrices d[m, n](beta) = <l m| exp(-i beta J_y) |l n> of betas (k,) [rad]: (k, 2 l + 1, 2 l + 1).

    Computed from the eigenvectors of J_y, whose eigenvalues are the integers -l..l: stable for every degree.
    """
    orders = np.arange(-degree, degree + 1)
    raising = np.diag(np.sqrt(degree * (degree + 1) - orders[:-1] * (orders[:-1] + 1.0)), -1)
    _, vectors = np.linalg.eigh((raising - raising.T) / 2j)
    phases = np.exp(-1j * np.asarray(betas)[:, None] * orders)
    return np.real((vectors * phases[:, None, :]) @ vectors.conj().T)


def _half_wigner(bandwidth: int, betas: np.ndarray) -> np.ndarray:
    """(orders, betas, bandwidth / 8, degrees, 8) float32, the CPU layout of correlation.cl, for n >= 0."""
    table = np.zeros((2 * bandwidth - 1, len(betas), bandwidth // 8, bandwidth // 2, 8), np.float32)
    for half in range(bandwidth // 2):
        degree = 2 * half
        blocks = degree // 8 + 1
        matrices = np.zeros((len(betas), 2 * degree + 1, 8 * blocks), np.float32)
        matrices[:, :, : degree + 1] = wigner_d(degree, betas)[:, :, degree:]
        orders = slice(bandwidth - 1 - degree, bandwidth + degree)
        table[orders, :, :blocks, half] = matrices.reshape(len(betas), -1, blocks, 8).swapaxes(0, 1)
    return table
