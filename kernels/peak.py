"""The highest peaks of a correlation, their neighborhoods, and how far they stand above the rest."""

from dataclasses import dataclass

import numpy as np
import pyopencl.array as cla

from kernels.device import Device
from kernels.errors import InputError
from kernels.launch import launch, require_array

_FLOOR = 0.05


@dataclass(frozen=True, slots=True)
class Peak:
    """One local maximum of a cyclic correlation.

    Attributes:
        index: (3,) int64, the voxel.
        shift: (3,) float64, cyclic and signed [voxels]: index (as -n/2..n/2) plus the sub-voxel offset.
        value: the correlation at the voxel.
        top: its height at the shift, between the voxels: that of the Gaussian that gave the sub-voxel offset. The
            same peak half a voxel off along all axes has half the value, and still its top.
        psr: peak-to-sidelobe ratio, (top - mean) / std; 0 where std is 0.
        neighborhood: (3, 3, 3) float32, the correlation around the voxel, cyclic.
        mean, std: of the whole correlation.
    """

    index: np.ndarray
    shift: np.ndarray
    value: float
    top: float
    psr: float
    neighborhood: np.ndarray
    mean: float
    std: float


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
            return [_peak(index[n], cubes[n], shape, mean, std) for n in kept]
        rows_at_once *= 4


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
        raise InputError("the correlation holds numbers that are not finite; look at the volumes that went in")
    return tops, float(mean), float(std)


def _allowed_rows(shape: tuple[int, ...], reach: list[int]) -> np.ndarray:
    """(n0 n1,) bool: rows within the reach along axes 0 and 1."""
    first, second = (np.abs(_signed(np.arange(n), n)) <= r for n, r in zip(shape[:2], reach[:2], strict=True))
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
    inside = np.abs(_signed(np.arange(n2), n2)) <= reach
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
        distance = np.abs(_signed((index[kept] - index[n]) % shape, np.array(shape)))
        if (distance.max(axis=1, initial=0) > separation).all():
            kept.append(int(n))
        if len(kept) == count:
            break
    return kept


def _peak(index: np.ndarray, cube: np.ndarray, shape: tuple[int, ...], mean: float, std: float) -> Peak:
    value = float(cube[1, 1, 1])
    lines = zip((cube[:, 1, 1], cube[1, :, 1], cube[1, 1, :]), shape, strict=True)
    fits = np.array([_fit_gaussian(line) if n > 2 else (0.0, 0.0) for line, n in lines])
    top = value * float(np.exp(fits[:, 1].sum()))
    return Peak(
        index=index,
        shift=_signed(index, np.array(shape)) + fits[:, 0],
        value=value,
        top=top,
        psr=(top - mean) / std if std > 0 else 0.0,
        neighborhood=cube,
        mean=mean,
        std=std,
    )


def _fit_gaussian(line: np.ndarray) -> tuple[float, float]:
    """The Gaussian through three values, the middle one the largest: where its peak lies, -0.5..0.5, and the
    logarithm of its height over the middle value."""
    if not line[1] > 0:
        return 0.0, 0.0
    left, middle, right = np.log(np.maximum(line.astype(np.float64) / line[1], _FLOOR))
    curvature = left - 2 * middle + right
    if curvature >= 0:
        return 0.0, 0.0
    offset = float(np.clip((left - right) / (2 * curvature), -0.5, 0.5))
    return offset, -0.5 * curvature * offset**2


def _signed(index: np.ndarray, n: int | np.ndarray) -> np.ndarray:
    """A cyclic index as -n/2..n/2."""
    return np.where(index < (np.asarray(n) + 1) // 2, index, index - n)
