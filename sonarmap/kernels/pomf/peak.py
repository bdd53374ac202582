"""The highest peaks of a correlation, with sub-voxel shifts and heights from a Gaussian fit."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import require_array
from sonarmap.kernels.errors import InputError

_LEAST_SHARE = 0.05  # of the peak; lower neighbors count as this share in the Gaussian fit


@dataclass(frozen=True, slots=True)
class Peak:
    """One local maximum of a cyclic correlation, a float for each number; or n of them, in arrays of n rows.

    Attributes:
        index: (3,) int64, the peak's voxel.
        shift: (3,) float64, cyclic and signed [voxels]: index (as -n/2..n/2) plus the sub-voxel offset.
        value: the correlation at the voxel, without a unit.
        top: height of the fitted Gaussian at the shift, without a unit. It does not depend on where the peak lies
            between voxels, whereas `value` is halved half a voxel off along all axes.
        psr: peak-to-sidelobe ratio, (top - mean) / std; 0 where std is 0.
        neighborhood: (3, 3, 3) float32, the correlation around the voxel, cyclic.
        mean, std: mean and standard deviation of the whole correlation, without a unit.
    """

    index: np.ndarray
    shift: np.ndarray
    value: Any
    top: Any
    psr: Any
    neighborhood: np.ndarray
    mean: Any
    std: Any

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, n: int | slice | np.ndarray) -> "Peak":
        return Peak(*(getattr(self, name)[n] for name in self.__slots__))


def fit_peaks(
    index: np.ndarray, cubes: np.ndarray, shape: tuple[int, ...], mean: float | np.ndarray, std: float | np.ndarray
) -> Peak:
    """Fit the peaks at voxels (m, 3), with neighborhoods (m, 3, 3, 3), of a cyclic correlation of `shape`. `mean` and
    `std` are those of the whole correlation, or (m,) for peaks of several correlations."""
    values = cubes[:, 1, 1, 1].astype(np.float64)
    lines = np.stack([cubes[:, :, 1, 1], cubes[:, 1, :, 1], cubes[:, 1, 1, :]], axis=1)
    offsets, heights = _fit_gaussians(lines)
    flat = np.array(shape) <= 2
    offsets[:, flat] = heights[:, flat] = 0.0
    shifts, tops = signed(index, np.array(shape)) + offsets, values * np.exp(heights.sum(axis=1))
    means, stds = (np.broadcast_to(np.asarray(each, np.float64), tops.shape) for each in (mean, std))
    ratios = np.divide(tops - means, stds, out=np.zeros(len(tops)), where=stds > 0)
    return Peak(index, shifts, values, tops, ratios, cubes, means, stds)


def _fit_gaussians(lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit Gaussians through three values (..., 3), the middle one the largest: offsets of their peaks, -0.5..0.5, and
    logarithms of their heights over the middle values. Both are 0 where the three values are equal."""
    middle = lines[..., 1:2].astype(np.float64)
    shares = np.divide(lines, middle, out=np.ones(lines.shape), where=middle > 0)
    logarithms = np.log(np.maximum(shares, _LEAST_SHARE))
    left, right = logarithms[..., 0], logarithms[..., 2]
    curvature = left + right
    offset = np.divide(left - right, 2 * curvature, out=np.zeros(curvature.shape), where=curvature < 0)
    offset = np.clip(offset, -0.5, 0.5)
    return offset, -0.5 * curvature * offset**2


def signed(index: np.ndarray, n: int | np.ndarray) -> np.ndarray:
    """Signed index, -n/2..n/2, of a cyclic index 0..n-1."""
    return np.where(index < (np.asarray(n) + 1) // 2, index, index - n)


NOT_FINITE = "the correlation has values that are not finite; check the input volumes"


def find_peaks(
    device: Device,
    correlation: cla.Array,
    count: int = 1,
    separation: float = 3,
    limits: tuple[float | None, float | None, float | None] | None = None,
) -> Peak:
    """The highest local maxima of a correlation, highest first; the host reads it whole.

    A peak is a voxel that none of its 26 cyclic neighbors exceeds; of two that are not separated the higher is kept.
    Its sub-voxel offset comes from a Gaussian through the three values along each axis. Neighbors below 5 % of the
    peak count as 5 %, which covers the negative sidelobes of an unblurred correlation too.

    Args:
        correlation: (n0, n1, n2) float32; it may be a view that starts anywhere in its buffer.
        separation: two peaks are farther apart than this, cyclically, along at least one axis [voxels].
        limits: largest absolute cyclic shift of a peak's voxel along each axis [voxels]; None: any.
            A voxel whose higher neighbor lies beyond a limit is not a peak.

    Returns:
        At most `count` peaks.
    """
    shape = require_array(correlation, "correlation", (None, None, None))
    if count < 1 or separation < 0:
        raise InputError(f"`count={count}`, `separation={separation}`; wanted at least 1 and 0")
    reach, values = _reach(shape, limits), correlation.get()
    mean, std = _moments(values)
    inside = [np.abs(signed(np.arange(n), n)) <= r for n, r in zip(shape, reach, strict=True)]
    tops = (values if inside[2].all() else values[:, :, inside[2]]).max(axis=2)
    tops = np.where(inside[0][:, None] & inside[1], tops, -np.inf).ravel()
    most, rows_at_once = int(np.count_nonzero(inside[0])) * int(np.count_nonzero(inside[1])), 8 * count
    while True:
        chosen, bound = _highest_rows(tops, min(rows_at_once, most))
        # maxima below the bound may be exceeded in a row that was not searched
        index, cubes = _local_maxima(values, chosen, inside[2], bound)
        kept = _suppress(index, cubes[:, 1, 1, 1], shape, count, separation)
        if len(kept) == count or np.isneginf(bound):
            return fit_peaks(index[kept], cubes[kept], shape, mean, std)
        rows_at_once *= 4


def _reach(shape: tuple[int, ...], limits: tuple[float | None, ...] | None) -> list[int]:
    """The largest absolute shift along each axis, in whole voxels."""
    limits = (None, None, None) if limits is None else limits
    if len(limits) != 3 or any(limit is not None and not limit >= 0 for limit in limits):
        raise InputError(f"`limits` are {limits}; wanted three numbers of voxels, 0 or more, or None")
    return [n if limit is None else min(n, int(limit)) for n, limit in zip(shape, limits, strict=True)]


def _moments(values: np.ndarray) -> tuple[float, float]:
    """Mean and standard deviation of a correlation; InputError if a value is not finite."""
    mean = values.mean()
    off = (values - mean).ravel()  # keeps precision if the mean is large
    std = float(np.sqrt(np.vdot(off, off) / off.size))
    if not np.isfinite(std):
        raise InputError(NOT_FINITE)
    return float(mean), std


def _highest_rows(tops: np.ndarray, count: int) -> tuple[np.ndarray, float]:
    """Indices of the `count` highest row maxima, in no order, and the highest of the other maxima, -inf without any."""
    others = len(tops) - count
    if not others:
        return np.arange(count), -np.inf
    order = np.argpartition(tops, others - 1)
    return order[others:], float(tops[order[others - 1]])


def _local_maxima(
    values: np.ndarray, rows: np.ndarray, inside: np.ndarray, bound: float
) -> tuple[np.ndarray, np.ndarray]:
    """Local maxima in these rows, in columns `inside` (n2,), not below the bound: index (m, 3) and neighborhood (m, 3,
    3, 3)."""
    n1 = values.shape[1]
    row, k = np.nonzero((values.reshape(-1, values.shape[2])[rows] >= bound) & inside)
    index = np.column_stack([rows[row] // n1, rows[row] % n1, k])
    # few voxels reach the bound: only those are compared with their neighbors
    around = (index[:, :, None] + np.arange(-1, 2)) % np.array(values.shape)[:, None]
    cubes = values[around[:, 0, :, None, None], around[:, 1, None, :, None], around[:, 2, None, None, :]]
    peaks = np.flatnonzero(cubes[:, 1, 1, 1] >= cubes.max(axis=(1, 2, 3)))
    return index[peaks], cubes[peaks]


def _suppress(
    index: np.ndarray, values: np.ndarray, shape: tuple[int, ...], count: int, separation: float
) -> list[int]:
    """Indices of at most `count` maxima that are not close to a higher one, highest first."""
    kept: list[int] = []
    # equal values are ordered by voxel, so that the order of the rows does not matter
    order = np.lexsort((index[:, 2], index[:, 1], index[:, 0], -values))
    free = np.ones(len(order), bool)
    for n in order:
        if not free[n]:
            continue
        kept.append(int(n))
        if len(kept) == count:
            break
        distance = np.abs(index - index[n])
        free &= np.minimum(distance, np.array(shape) - distance).max(axis=1) > separation
    return kept
