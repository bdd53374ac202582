"""Correlate points under several poses with a target in batches: the highest peaks, or the highest near a shift."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray

from sonarmap.kernels.device.arrays import Pending, Readback
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import affine_rows, launch, zero
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import row_pitch
from sonarmap.kernels.points.voxelize import voxelize_poses
from sonarmap.kernels.pomf.passes import make_passes
from sonarmap.kernels.pomf.peak import NOT_FINITE, Peak, find_peaks, fit_peaks
from sonarmap.kernels.pomf.spectrum import half_weights

_CAPACITY = 256  # local maxima stored for a correlation, as in choose.cl
_RECORD = 28  # numbers of a local maximum, as in choose.cl
_ROWS_PER_PEAK = 32  # rows searched for each wanted peak, which is the maximum of about nine rows
_ROWS_PER_ITEM = 16  # rows of a work-item on a CPU
_GROUP = 256  # work-items of a group on a GPU
_BATCH_VOXELS = 2**19  # voxels of a batch, few enough for a CPU's cache
_BATCH_VOLUMES = 8  # most volumes of a batch
# Rows of sums for each shift, as in near.cl: 5 x 5 shifts along the first axes, one of power and mean, and four unused.
_SUMS = 30


def at_once(edge: int) -> int:
    """Number of poses of the fastest batch on a grid of `edge` voxels."""
    return min(_BATCH_VOLUMES, max(1, _BATCH_VOXELS // edge**3))


@dataclass(frozen=True, slots=True)
class Pose:
    """Motion of the points before they are voxelized, and the largest shifts of the peaks."""

    R: np.ndarray  # (3, 3) rotation
    offset: np.ndarray | None = None  # (3,) shift after the rotation [voxels], or None
    limits: np.ndarray | None = None  # (3,) largest absolute cyclic shift of a peak's voxel [voxels], or None for any


@dataclass(frozen=True, slots=True)
class FoundPeaks:
    """Peaks of several correlations, by exponent, then by pose, highest first."""

    exponent: np.ndarray  # (n,) int64
    pose: np.ndarray  # (n,) int64
    peaks: Peak

    def of(self, pose: int, exponent: int = 0) -> Peak:
        """The peaks of one correlation."""
        return self.peaks[(self.pose == pose) & (self.exponent == exponent)]


class Correlator:
    """Phase-only matched filtering (Sect. 2.1 of the paper) of a target with points under any number of poses.

    A correlation peaks at the shift s (cyclic) with target(x) = source(x - s). Its spectrum is the target's times the
    conjugate of the source's whitened one, times a Gaussian. A call queues all of its work before it reads results.
    """

    def __init__(
        self, device: Device, edge: int, blur: float, exponents: tuple[float, ...] = (1.0,), most: int = 1
    ) -> None:
        """Plan the transforms and allocate about (4 + 8 exponents) bytes for each voxel and pose, for batches of `most`
        poses. `blur` is the standard deviation of the Gaussian that correlations are convolved with [voxels]."""
        self.device, self.edge, self.exponents, self.most = device, edge, exponents, most
        cubes = most * len(exponents)
        # empty at first, so that a CPU needs no kernel to clear them
        self._volumes = device.to_device(np.zeros((most, edge, edge, edge), np.float32))
        self._marks = device.to_device(np.zeros((most, -(-(edge**2) // 8)), np.int32))
        self._spectra = device.empty((cubes, edge, edge, row_pitch(edge)), np.complex64)
        self._passes = make_passes(device, edge, blur, exponents, most)
        # correlations, the maxima of their rows, and the energies of their spectra
        self._values, self._tops = device.empty((cubes, edge, edge, edge)), device.empty((cubes, edge, edge))
        self._energies = device.empty((cubes, self._passes.parts + 1))
        # thresholds and local maxima of the correlations; see choose.cl
        self._states = device.empty((cubes, 4))
        self._maxima = device.empty((cubes, _CAPACITY, _RECORD), np.int32)
        self._clean = True

    def find(
        self, points: cla.Array, poses: Sequence[Pose], targets: Sequence[cla.Array], count: int, separation: float
    ) -> FoundPeaks:
        """The highest peaks of the correlation for each pose and exponent, by the rules of `find_peaks`.

        Args:
            points: (n, 4) float32, as in `voxelize`.
            targets: the target's whitened spectrum for each exponent, (edge, edge, `row_pitch(edge)`) complex64.
        """
        rows = self._upload(poses)
        out = self.device.empty((len(poses), len(self.exponents), 4 + _RECORD * count), np.int32)
        for first in range(0, len(poses), self.most):
            now = min(self.most, len(poses) - first)
            self._correlate(points, rows, first, now, targets)
            self._choose(rows, separation, first, now, out)
        records = out.get()
        for n, exponent in np.argwhere(records[:, :, 0] < 0).tolist():  # more maxima than the device lists
            correlation, limits = self.correlations(points, poses[n], targets)[exponent], poses[n].limits
            reach = None if limits is None else (float(limits[0]), float(limits[1]), float(limits[2]))
            peaks = find_peaks(self.device, correlation, count, separation, reach)
            rows = np.ravel_multi_index(tuple(peaks.index.T), correlation.shape)
            cubes = np.ascontiguousarray(peaks.neighborhood).reshape(-1, _RECORD - 1).view(np.int32)
            records[n, exponent, 0] = len(peaks)
            records[n, exponent, 4 : 4 + _RECORD * len(peaks)] = np.column_stack([rows, cubes]).ravel()
        return _chosen_peaks(records, self.edge)

    def near(
        self, points: cla.Array, poses: Sequence[Pose], targets: Sequence[cla.Array], shifts: np.ndarray
    ) -> Pending[Peak]:
        """The highest of the 27 voxels around a shift, (poses, 3) int64, cyclic [voxels], in each pose's correlation
        for the first exponent. Other arguments as in `find`; the poses' limits are ignored."""
        rows = self._upload(poses)
        out = self.device.empty((len(poses), _SUMS, row_pitch(self.edge)), np.complex64)
        places = np.asarray(shifts) % self.edge
        for first in range(0, len(poses), self.most):
            now = min(self.most, len(poses) - first)
            self._voxelize(points, rows, first, now)
            for n in range(now):
                self._passes.near(self._spectra, n, targets[0], places[first + n], out, first + n)
        copy = Readback(self.device, out)
        return Pending(lambda: _highest_near(self.edge, places, copy.read()))

    def at(
        self, points: cla.Array, pose: Pose, targets: Sequence[cla.Array], places: np.ndarray
    ) -> Pending[NDArray[np.float32]]:
        """Trilinear samples (exponents, m) of each exponent's correlation at cyclic places (m, 3) [voxels]; other
        arguments as in `find`."""
        self.correlations(points, pose, targets)
        rows = np.zeros((len(places), 4), np.float32)
        rows[:, :3] = places
        at, out = self.device.to_device(rows), self.device.empty((len(self.exponents), len(rows)))
        arguments = self._values, at, out, np.int32(self.edge), np.int32(len(rows))
        lanes = 8 if self._passes.clears else 1
        launch(self.device, "pomf/near", "sample", out.shape[::-1], *arguments, group=None, LANES=lanes)
        copy = Readback(self.device, out)
        return Pending(copy.read)

    def correlations(self, points: cla.Array, pose: Pose, targets: Sequence[cla.Array]) -> list[cla.Array]:
        """The correlation (edge, edge, edge) float32 for each exponent; the next call overwrites the arrays."""
        self._correlate(points, self._upload([Pose(pose.R, pose.offset)]), 0, 1, targets)
        return [self._values[e] for e in range(len(self.exponents))]

    def _upload(self, poses: Sequence[Pose]) -> cla.Array:
        """Upload poses as rows (m, 20) float32 in the layout of voxelize.cl and choose.cl."""
        rows, anywhere = np.zeros((len(poses), 20), np.float32), np.full(3, self.edge)
        R = np.array([pose.R for pose in poses]).reshape(-1, 3, 3)
        offsets = np.array([np.zeros(3) if pose.offset is None else pose.offset for pose in poses]).reshape(-1, 3)
        limits = np.array([anywhere if pose.limits is None else pose.limits for pose in poses]).reshape(-1, 3)
        rows[:, :16] = affine_rows(R, offsets + (self.edge / 2 + 0.5)).reshape(-1, 16)
        rows[:, 16:19] = np.floor(np.minimum(limits, self.edge))
        return self.device.to_device(rows)

    def _voxelize(self, points: cla.Array, rows: cla.Array, first: int, now: int) -> None:
        """Queue the spectra of the points under a batch of poses; fused passes do not transform the first axis yet."""
        if not self._clean:
            zero(self.device, self._volumes)
            zero(self.device, self._marks)
        self._clean = False
        voxelize_poses(self.device, points, self._volumes, self._marks, rows, first, now)
        self._passes.forward(self._volumes, self._marks, self._spectra, now)
        self._clean = self._passes.clears

    def _correlate(
        self, points: cla.Array, rows: cla.Array, first: int, now: int, targets: Sequence[cla.Array]
    ) -> None:
        self._voxelize(points, rows, first, now)
        self._passes.correlate(self._spectra, targets, self._energies, now)
        self._passes.inverse(self._values, self._spectra, self._tops, rows, now, first)

    def _choose(self, poses: cla.Array, separation: float, first: int, now: int, out: cla.Array) -> None:
        """Queue the selection of the correlations' n highest peaks, into out (poses, exponents, 4 + 28 n) int32."""
        fused = self._passes.clears
        wanted, cubes = (out.shape[2] - 4) // _RECORD, now * len(self.exponents)
        rows, rows_per_item, width = self.edge**2, _ROWS_PER_ITEM if fused else 1, 1 if fused else _GROUP
        macros = {"ROWS": rows_per_item, "WIDTH": width}
        counts = np.int32(now), np.int32(first), np.int32(self.edge)
        parts, searched = np.int32(self._passes.parts), np.int32(min(_ROWS_PER_PEAK * wanted, rows))
        arrays = self._tops, self._energies, poses, self._states, parts, searched
        launch(self.device, "pomf/choose", "threshold", (cubes * width,), *arrays, *counts, group=(width,), **macros)
        arrays = self._values, self._tops, poses, self._states, self._maxima
        size = rows // rows_per_item, cubes
        launch(self.device, "pomf/choose", "collect", size, *arrays, *counts, group=None, **macros)
        arrays = self._states, self._maxima, out, np.int32(wanted), np.float32(separation)
        launch(self.device, "pomf/choose", "choose", (cubes,), *arrays, *counts, group=None, **macros)


def _chosen_peaks(records: np.ndarray, n: int) -> FoundPeaks:
    """Peaks from records (poses, exponents, numbers) of choose.cl."""
    statistics = records[:, :, 1:3].view(np.float32).astype(np.float64)
    if not np.isfinite(statistics).all():
        raise InputError(NOT_FINITE)
    poses, exponents, length = records.shape
    peaks = records[:, :, 4:].reshape(poses, exponents, length // _RECORD, _RECORD)
    exponent, pose, number = np.nonzero(np.arange(peaks.shape[2]) < records[:, :, :1].swapaxes(0, 1))
    rows = peaks[pose, exponent, number]
    index = np.stack(np.unravel_index(rows[:, 0], (n, n, n)), axis=1)
    cubes = np.ascontiguousarray(rows[:, 1:]).view(np.float32).reshape(-1, 3, 3, 3)
    mean, std = statistics[pose, exponent].T
    return FoundPeaks(exponent, pose, fit_peaks(index, cubes, (n, n, n), mean, std))


def _highest_near(edge: int, places: NDArray[np.int64], sums: NDArray[np.complex64]) -> Peak:
    """The highest of the 27 voxels around each place (m, 3), peak or slope, from near.cl's sums (m, `_SUMS`, pitch).
    The mean is the term of frequency 0; the deviation follows from the spectrum's power by Parseval's theorem."""
    n, exact = edge, sums.astype(np.complex128)
    if not np.isfinite(exact.view(np.float64)).all():
        raise InputError(NOT_FINITE)
    weights = half_weights(n)
    mean = exact[:, 25, 0].imag / n**3
    variance = exact[:, 25].real @ weights / n**6 - mean**2
    around = _values(edge, places, exact[:, :25] * weights)
    inner = around[:, 1:-1, 1:-1, 1:-1].reshape(len(around), 27)
    highest = inner.argmax(axis=1)
    tops = np.column_stack([highest // 9, highest // 3 % 3, highest % 3])
    cubes = np.stack(
        [cube[i : i + 3, j : j + 3, k : k + 3] for cube, (i, j, k) in zip(around, tops.tolist(), strict=True)]
    )
    return fit_peaks((places + tops - 1) % n, cubes, (n, n, n), mean, np.sqrt(np.maximum(variance, 0)))


def _values(n: int, places: NDArray[np.int64], sums: np.ndarray) -> np.ndarray:
    """Values (m, 5, 5, 5) float32 around the places: sums (m, 25, pitch) transformed along the last axis."""
    columns = places[:, 2, None] + np.arange(-2, 3)
    turns: NDArray[np.int64] = np.arange(row_pitch(n))[:, None] * columns[:, None, :] % n
    values = np.real(np.matmul(sums, np.exp(2j * np.pi / n * turns))) / n**3
    return values.reshape(-1, 5, 5, 5).astype(np.float32)
