"""The highest peaks of several correlations, chosen on the device and read at once."""

from dataclasses import dataclass

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import launch
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.pomf.peak import NOT_FINITE
from sonarmap.kernels.pomf.peak_fit import Peak, fit_peaks

_CAPACITY, _RECORD = 256, 28  # as in choose.cl
# So many rows for each peak are looked through before the best are chosen: a peak is the maximum of some nine rows.
_ROWS_OF_A_PEAK = 32
_ROWS_TOGETHER, _GROUP = 16, 256


@dataclass(frozen=True, slots=True)
class Correlations:
    """Correlations on the device, and what their peaks are chosen by; c of them, in the order that choose.cl says."""

    values: cla.Array  # (c, edge, edge, edge) float32
    tops: cla.Array  # (c, edge, edge) float32, the maxima of their rows
    energies: cla.Array  # (c, parts + 1) float32, of their spectra


class Chooser:
    """Chooses peaks of correlations of one cubic shape; see choose.cl for the arrays."""

    def __init__(self, device: Device, edge: int, most: int, parts: int, cpu: bool) -> None:
        """Take the memory for `most` correlations, whose energies have so many parts."""
        self._device, self._edge, self._parts, self._cpu = device, edge, parts, cpu
        self._states = device.empty((most, 4))
        self._maxima = device.empty((most, _CAPACITY, _RECORD), np.int32)

    def output(self, poses: int, exponents: int, count: int) -> cla.Array:
        """(poses, exponents, 4 + 28 count) int32, for `choose` to write to."""
        return self._device.empty((poses, exponents, 4 + _RECORD * count), np.int32)

    def choose(
        self, correlations: Correlations, poses: cla.Array, separation: float, now: tuple[int, int], out: cla.Array
    ) -> None:
        """Queue the choice of the peaks of some poses, number and first of them `now`, into `out`."""
        count, first = np.int32(now[0]), np.int32(now[1])
        wanted, rows = (out.shape[2] - 4) // _RECORD, self._edge**2
        cubes, together = now[0] * out.shape[1], _ROWS_TOGETHER if self._cpu else 1
        width = 1 if self._cpu else _GROUP
        macros = dict.fromkeys(("IMAGES", "HEIGHT", "LENGTH"), self._edge) | {"ROWS": together, "WIDTH": width}
        launch(
            self._device, "pomf/choose", "threshold", (cubes * width,), correlations.tops, correlations.energies, poses,
            self._states, np.int32(self._parts), np.int32(min(_ROWS_OF_A_PEAK * wanted, rows)), count, first,
            group=(width,), **macros,
        )  # fmt: skip
        launch(
            self._device, "pomf/choose", "collect", (rows // together, cubes), correlations.values, correlations.tops,
            poses, self._states, self._maxima, count, first, group=None, **macros,
        )  # fmt: skip
        launch(
            self._device, "pomf/choose", "choose", (cubes,), self._states, self._maxima, out, np.int32(wanted),
            np.float32(separation), count, first, group=None, **macros,
        )  # fmt: skip

    def read(self, out: cla.Array) -> tuple[list[list[list[Peak]]], list[tuple[int, int]]]:
        """For each pose and exponent its peaks; and those (pose, exponent) where more may be hidden."""
        records, n = out.get(), self._edge
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
