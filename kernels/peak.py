"""The highest peaks of a correlation, their neighborhoods, and how far they stand above the rest."""

import numpy as np
import pyopencl.array as cla

from kernels.device import Device
from kernels.errors import InputError
from kernels.launch import launch, require_array
from kernels.peak_fit import Peak, fit_peak, signed

__all__ = ["Peak", "find_peaks", "peak_at", "segment_peaks"]

_NOT_FINITE = "the correlation holds numbers that are not finite; look at the volumes that went in"


def find_peaks(
    device: Device,
    correlation: cla.Array,
    count: int = 1,
    separation: float = 3,
    limits: tuple[float | None, float | None, float | None] | None = None,
) -> list[Peak]:
    """The highest local maxima of a correlation, highest first.

    A peak is a voxel that none of its 26 cyclic neighbors exceeds; of two not separated the higher stays.
    Its sub-voxel offset is that of the Gaussian through the three values along each axis; neighbors below
    5 % of the peak count as 5 %, which serves the negative sidelobes of an unblurred correlation too.

    Args:
        correlation: (n0, n1, n2) float32.
        count: how many peaks to look for.
        separation: the cyclic distance of two peaks is above this along at least one axis [voxels].
        limits: largest absolute cyclic shift of a peak's voxel along each axis [voxels]; None: any.
            A maximum that only the limit makes, on a slope, is no peak.

    Returns:
        At most count peaks; fewer where there are no more.

    Raises:
        InputError: an argument is not as above, or the correlation is not finite.
    """
    shape = require_array(correlation, "correlation", (None, None, None))
    if count < 1 or separation < 0:
        raise InputError(f"count is {count} and separation {separation}; wanted at least 1 and 0")
    reach = _reach(shape, limits)
    tops, mean, std = _statistics(device, correlation, reach[2])
    allowed = _allowed_rows(shape, reach)
    tops = np.where(allowed, tops, -np.inf)
    most, rows_at_once = int(np.count_nonzero(allowed)), 8 * count
    while True:
        chosen, bound = _highest_rows(tops, min(rows_at_once, most))
        index, cubes = _local_maxima(device, correlation, chosen, reach[2])
        # a maximum below the best row that was not looked at may be beaten from there
        known = cubes[:, 1, 1, 1] >= bound
        index, cubes = index[known], cubes[known]
        kept = _suppress(index, cubes[:, 1, 1, 1], shape, count, separation)
        if len(kept) == count or np.isneginf(bound):
            return [fit_peak(index[n], cubes[n], shape, mean, std) for n in kept]
        rows_at_once *= 4


def peak_at(device: Device, correlation: cla.Array, index: np.ndarray) -> Peak:
    """The highest of the 27 voxels around a cyclic index (3,), whether it is a peak or lies on a slope.

    Args:
        correlation: (n0, n1, n2) float32.
        index: int64, of any sign.

    Raises:
        InputError: an argument is not as above, or the correlation is not finite.
    """
    shape = require_array(correlation, "correlation", (None, None, None))
    if np.shape(index) != (3,) or not np.issubdtype(index.dtype, np.integer):
        raise InputError(f"the index is {index}; wanted three whole numbers")
    _, mean, std = _statistics(device, correlation, shape[2])
    around = _cube(device, correlation, index, 2)
    inner = around[1:-1, 1:-1, 1:-1]
    top = np.array(np.unravel_index(int(inner.argmax()), inner.shape))
    cube = around[tuple(slice(k, k + 3) for k in top)]
    return fit_peak((index + top - 1) % shape, cube, shape, mean, std)


def _cube(device: Device, correlation: cla.Array, index: np.ndarray, reach: int) -> np.ndarray:
    """The voxels within `reach` of a cyclic index along each axis: (2 reach + 1,) * 3 float32."""
    n0, n1, n2 = correlation.shape
    steps = np.arange(-reach, reach + 1)
    rows = (index[0] + steps)[:, None] % n0 * n1 + (index[1] + steps) % n1
    gathered = device.empty((rows.size, n2))
    wanted = device.to_device(rows.astype(np.int32).ravel())
    launch(device, "peak", "gather_rows", (rows.size,), correlation, wanted, gathered, LENGTH=n2)
    return gathered.get()[:, (index[2] + steps) % n2].reshape((len(steps),) * 3)


def segment_peaks(device: Device, correlation: cla.Array, segments: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """The highest local maximum of every segment of every row, for many peaks at once; not refined, not suppressed.

    Args:
        correlation: (n0, n1, n2) float32.
        segments: into how many parts a row is divided; n2 is a multiple of it.

    Returns:
        (m, 3) int64 indices and (m,) float32 values, highest first; equal values in the order of their voxels.

    Raises:
        InputError: an argument is not as above, or the correlation is not finite.
    """
    shape = require_array(correlation, "correlation", (None, None, None))
    if segments < 1 or shape[2] % segments:
        raise InputError(f"rows of {shape[2]} voxels have no {segments} equal segments")
    found = device.empty((2, shape[0] * shape[1] * segments))
    size, sizes = (shape[1], shape[0]), (np.int32(shape[0]), np.int32(shape[1]))
    launch(
        device, "peak", "segment_maxima", size, correlation, found, *sizes, LENGTH=shape[2], SEGMENTS=segments
    )  # fmt: skip
    values, columns = found.get()
    if np.isnan(values).any():
        raise InputError(_NOT_FINITE)
    kept = np.flatnonzero(values > -np.inf)
    kept = kept[np.argsort(-values[kept], kind="stable")]
    row = kept // segments
    index = np.column_stack([row // shape[1], row % shape[1], columns[kept].astype(np.int64)])
    return index, values[kept]


def _reach(shape: tuple[int, ...], limits: tuple[float | None, ...] | None) -> list[int]:
    """The largest absolute shift along each axis, in whole voxels."""
    limits = (None, None, None) if limits is None else limits
    if len(limits) != 3 or any(limit is not None and not limit >= 0 for limit in limits):
        raise InputError(f"limits are {limits}; wanted three numbers of voxels, 0 or more, or None")
    return [n if limit is None else min(n, int(limit)) for n, limit in zip(shape, limits, strict=True)]


def _statistics(device: Device, correlation: cla.Array, reach: int) -> tuple[np.ndarray, float, float]:
    """The maximum of every row, within the reach along it; mean and standard deviation of all."""
    rows, length = correlation.size // correlation.shape[2], correlation.shape[2]
    parts = device.empty((3, rows))
    launch(device, "peak", "row_statistics", (rows,), correlation, parts, np.int32(reach), LENGTH=length)
    tops, row_means, row_squares = parts.get()
    row_means = row_means.astype(np.float64)
    mean = row_means.mean()
    total = row_squares.sum(dtype=np.float64) + length * np.square(row_means - mean).sum()
    std = np.sqrt(total / correlation.size)
    if not np.isfinite(std):
        raise InputError(_NOT_FINITE)
    return tops, float(mean), float(std)


def _allowed_rows(shape: tuple[int, ...], reach: list[int]) -> np.ndarray:
    """(n0 n1,) bool: rows within the reach along axes 0 and 1."""
    first, second = (np.abs(signed(np.arange(n), n)) <= r for n, r in zip(shape[:2], reach[:2], strict=True))
    return (first[:, None] & second[None, :]).ravel()


def _highest_rows(tops: np.ndarray, count: int) -> tuple[np.ndarray, float]:
    """The rows with the highest maxima, in no order, and the highest maximum of the others, -inf without others."""
    order = np.argpartition(-tops, count - 1)
    return order[:count], float(tops[order[count:]].max(initial=-np.inf))


def _local_maxima(
    device: Device, correlation: cla.Array, rows: np.ndarray, reach: int
) -> tuple[np.ndarray, np.ndarray]:
    """The local maxima in some rows: index (m, 3) and neighborhood (m, 3, 3, 3)."""
    n0, n1, n2 = correlation.shape
    i, j = rows[:, None, None] // n1, rows[:, None, None] % n1
    around = (i + np.array([-1, 0, 1])[:, None]) % n0 * n1 + (j + np.array([-1, 0, 1])) % n1
    wanted = device.to_device(around.astype(np.int32).ravel())
    gathered = device.empty((wanted.size, n2))
    launch(device, "peak", "gather_rows", (wanted.size,), correlation, wanted, gathered, LENGTH=n2)
    block = gathered.get().reshape(len(rows), 3, 3, n2)
    block = np.concatenate([block[..., -1:], block, block[..., :1]], axis=-1)
    across = block.max(axis=(1, 2))
    highest = np.maximum(np.maximum(across[:, :-2], across[:, 1:-1]), across[:, 2:])
    inside = np.abs(signed(np.arange(n2), n2)) <= reach
    row, column = np.nonzero((block[:, 1, 1, 1:-1] >= highest) & inside)
    cubes = np.stack([block[row, :, :, column + offset] for offset in range(3)], axis=-1)
    index = np.column_stack([rows[row] // n1, rows[row] % n1, column])
    return index, cubes


def _suppress(
    index: np.ndarray, values: np.ndarray, shape: tuple[int, ...], count: int, separation: float
) -> list[int]:
    """Which maxima stay, highest first: those not close to a higher one."""
    kept: list[int] = []
    # equal values come in the order of their voxels, whatever the order of the rows was
    for n in np.lexsort((index[:, 2], index[:, 1], index[:, 0], -values)):
        distance = np.abs(signed((index[kept] - index[n]) % shape, np.array(shape)))
        if (distance.max(axis=1, initial=0) > separation).all():
            kept.append(int(n))
        if len(kept) == count:
            break
    return kept
