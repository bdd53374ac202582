"""Points under several poses, correlated with a target at once: the highest peaks, or what lies near a shift."""

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

_CAPACITY = 256  # local maxima that a correlation can have, as in choose.cl
_RECORD = 28  # numbers of each, likewise
_ROWS_OF_A_PEAK = 32  # that are looked through before the best are chosen: a peak is the maximum of some nine rows
_ROWS_TOGETHER = 16  # rows of a processor's work-item
_GROUP = 256  # work-items of a group elsewhere
# What is worked on at once is few enough for a processor's cache.
_VOXELS = 2**19
_MOST = 8  # volumes
# Rows of sums for each shift, as in near.cl: 5 x 5 shifts along the first axes, then five of which two are the power's.
_SUMS = 30


def at_once(edge: int) -> int:
    """How many poses are best worked on at once on a grid."""
    return min(_MOST, max(1, _VOXELS // edge**3))


@dataclass(frozen=True, slots=True)
class Pose:
    """How points are moved before they are put into voxels, and which peaks count then."""

    R: np.ndarray  # (3, 3) rotation
    offset: np.ndarray | None = None  # (3,) shift after it [voxels], or None
    limits: np.ndarray | None = None  # (3,) largest absolute cyclic shift of a peak's voxel [voxels], or None for any


class Correlator:
    """Phase-only matched filtering (Sect. 2.1 of the paper) of a target with points under any number of poses.

    A correlation peaks at the shift s (cyclic) with target(x) = source(x - s). Its spectrum is the target's times the
    conjugate of the source's whitened one, times a Gaussian. All of a call's work is queued, then read at once.
    """

    def __init__(
        self, device: Device, edge: int, blur: float, exponents: tuple[float, ...] = (1.0,), most: int = 1
    ) -> None:
        """Plan the transforms and take the memory, about (4 + 8 exponents) bytes for a voxel and pose, of which `most`
        are worked on at once. The blur is that of the Gaussian that correlations are convolved with [voxels]."""
        self.device, self.edge, self.exponents, self.most = device, edge, exponents, most
        cubes = most * len(exponents)
        self._volumes = device.empty((most, edge, edge, edge))
        self._marks = device.empty((most, -(-(edge**2) // 8)), np.int32)
        self._spectra = device.empty((cubes, edge, edge, row_pitch(edge)), np.complex64)
        self._passes = make_passes(device, edge, blur, exponents, most)
        # correlations, the maxima of their rows, and the energies of their spectra
        self._values, self._tops = device.empty((cubes, edge, edge, edge)), device.empty((cubes, edge, edge))
        self._energies = device.empty((cubes, self._passes.parts + 1))
        # what their peaks are chosen by; see choose.cl
        self._states = device.empty((cubes, 4))
        self._maxima = device.empty((cubes, _CAPACITY, _RECORD), np.int32)
        self._clean = False

    def find(
        self, points: cla.Array, poses: Sequence[Pose], targets: Sequence[cla.Array], count: int, separation: float
    ) -> list[list[list[Peak]]]:
        """For each pose and exponent the highest peaks, as `find_peaks` finds them in the correlation.

        Args:
            points: (n, 4) float32, as `voxelize` takes them.
            targets: for each exponent the whitened spectrum (edge, edge, `row_pitch(edge)`) complex64.
        """
        rows = self._upload(poses)
        out = self.device.empty((len(poses), len(self.exponents), 4 + _RECORD * count), np.int32)
        for first in range(0, len(poses), self.most):
            now = min(self.most, len(poses) - first)
            self._correlate(points, rows, first, now, targets)
            self._choose(rows, separation, first, now, out)
        peaks, hidden = _chosen_peaks(out.get(), self.edge)
        for n in sorted({n for n, _ in hidden}):
            correlations, limits = self.correlations(points, poses[n], targets), poses[n].limits
            reach = None if limits is None else (float(limits[0]), float(limits[1]), float(limits[2]))
            for e in (e for pose, e in hidden if pose == n):
                peaks[n][e] = find_peaks(self.device, correlations[e], count, separation, reach)
        return peaks

    def near(
        self, points: cla.Array, poses: Sequence[Pose], targets: Sequence[cla.Array], shifts: np.ndarray
    ) -> Pending[list[Peak]]:
        """The highest of the 27 voxels about a shift in each pose's correlation with the first exponent; arguments as
        of `find`, and (poses, 3) int64 cyclic shifts [voxels]. The poses' limits do not count."""
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
        """(exponents, m) each exponent's correlation at cyclic places (m, 3) [voxels], trilinear; arguments as of
        `find`."""
        self.correlations(points, pose, targets)
        rows = np.zeros((len(places), 4), np.float32)
        rows[:, :3] = places
        at, out = self.device.to_device(rows), self.device.empty((len(self.exponents), len(rows)))
        numbers = np.int32(self.edge), np.int32(len(rows))
        arrays = self._values, at, out
        launch(self.device, "pomf/peak", "sample", out.shape[::-1], *arrays, *numbers, group=None)
        copy = Readback(self.device, out)
        return Pending(copy.read)

    def correlations(self, points: cla.Array, pose: Pose, targets: Sequence[cla.Array]) -> list[cla.Array]:
        """For each exponent the correlation (edge, edge, edge) float32; the arrays are used again by the next call."""
        self._correlate(points, self._upload([Pose(pose.R, pose.offset)]), 0, 1, targets)
        return [self._values[e] for e in range(len(self.exponents))]

    def _upload(self, poses: Sequence[Pose]) -> cla.Array:
        """(m, 20) float32, as voxelize.cl and choose.cl take them."""
        rows = np.zeros((len(poses), 20), np.float32)
        for row, pose in zip(rows, poses, strict=True):
            shift = np.zeros(3) if pose.offset is None else np.asarray(pose.offset, np.float64)
            row[:16] = affine_rows(pose.R, shift + (self.edge / 2 + 0.5)).ravel()
            row[16:19] = self.edge if pose.limits is None else np.floor(np.minimum(pose.limits, self.edge))
        return self.device.to_device(rows)

    def _voxelize(self, points: cla.Array, rows: cla.Array, first: int, now: int) -> None:
        """Queue the transforms of the points under some poses, all but the first axis where the passes are fused."""
        if not self._clean:
            zero(self.device, self._volumes)
            self._marks.fill(0)
        self._clean = False
        voxelize_poses(self.device, points, self._volumes[:now], self._marks[:now], rows, first)
        self._passes.forward(self._volumes, self._marks, self._spectra, now)
        self._clean = self._passes.clears

    def _correlate(
        self, points: cla.Array, rows: cla.Array, first: int, now: int, targets: Sequence[cla.Array]
    ) -> None:
        self._voxelize(points, rows, first, now)
        self._passes.correlate(self._spectra, targets, self._energies, now)
        self._passes.inverse(self._values, self._spectra, self._tops, rows, now, first)

    def _choose(self, poses: cla.Array, separation: float, first: int, now: int, out: cla.Array) -> None:
        """Queue the choice of the peaks of the last correlations, into out (poses, exponents, 4 + 28 n) int32."""
        fused = self._passes.clears
        wanted, cubes = (out.shape[2] - 4) // _RECORD, now * len(self.exponents)
        rows, together, width = self.edge**2, _ROWS_TOGETHER if fused else 1, 1 if fused else _GROUP
        macros = dict.fromkeys(("IMAGES", "HEIGHT", "LENGTH"), self.edge) | {"ROWS": together, "WIDTH": width}
        counts = np.int32(now), np.int32(first)
        parts, looked_at = np.int32(self._passes.parts), np.int32(min(_ROWS_OF_A_PEAK * wanted, rows))
        arrays = self._tops, self._energies, poses, self._states, parts, looked_at
        launch(self.device, "pomf/choose", "threshold", (cubes * width,), *arrays, *counts, group=(width,), **macros)
        arrays = self._values, self._tops, poses, self._states, self._maxima
        launch(self.device, "pomf/choose", "collect", (rows // together, cubes), *arrays, *counts, group=None, **macros)
        arrays = self._states, self._maxima, out, np.int32(wanted), np.float32(separation)
        launch(self.device, "pomf/choose", "choose", (cubes,), *arrays, *counts, group=None, **macros)


def _chosen_peaks(records: np.ndarray, n: int) -> tuple[list[list[list[Peak]]], list[tuple[int, int]]]:
    """For each pose and exponent its peaks; and those (pose, exponent) where more may be hidden."""
    poses, exponents, length = records.shape
    statistics = records[:, :, 1:3].view(np.float32).astype(np.float64)
    if not np.isfinite(statistics).all():
        raise InputError(NOT_FINITE)
    chosen = np.maximum(records[:, :, 0], 0)
    peaks = records[:, :, 4:].reshape(poses, exponents, (length - 4) // _RECORD, _RECORD)
    which = np.arange(peaks.shape[2]) < chosen[:, :, None]
    index = np.stack(np.unravel_index(peaks[which][:, 0], (n, n, n)), axis=1)
    cubes = np.ascontiguousarray(peaks[which][:, 1:]).view(np.float32).reshape(-1, 3, 3, 3)
    mean, std = np.repeat(statistics.reshape(-1, 2), chosen.ravel(), axis=0).T
    fits = iter(fit_peaks(index, cubes, (n, n, n), mean, std))
    found = [[[next(fits) for _ in range(many)] for many in row] for row in chosen.tolist()]
    hidden = [(int(pose), int(exponent)) for pose, exponent in np.argwhere(records[:, :, 0] < 0)]
    return found, hidden


def _highest_near(edge: int, places: NDArray[np.int64], sums: NDArray[np.complex64]) -> list[Peak]:
    """For each voxel (m, 3) the highest of the 27 around it, peak or slope; sums (m, `_SUMS`, pitch) are of near.cl.
    The mean is the term of frequency 0, the deviation that of the spectrum, by Parseval's theorem."""
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
    """(m, 5, 5, 5) float32: the last axis of the sums (m, 25, pitch), by frequency, at 5 voxels."""
    columns = places[:, 2, None] + np.arange(-2, 3)
    turns: NDArray[np.int64] = np.arange(row_pitch(n))[:, None] * columns[:, None, :] % n
    values = np.real(np.matmul(sums, np.exp(2j * np.pi / n * turns))) / n**3
    return values.reshape(-1, 5, 5, 5).astype(np.float32)
