"""A peak of a correlation, with its place and height between the voxels, by a Gaussian."""

from dataclasses import dataclass

import numpy as np

_FLOOR = 0.05


@dataclass(frozen=True, slots=True)
class Peak:
    """One local maximum of a cyclic correlation.

    Attributes:
        index: (3,) int64, the voxel.
        shift: (3,) float64, cyclic and signed [voxels]: index (as -n/2..n/2) plus the sub-voxel offset.
        value: the correlation at the voxel, without a unit.
        top: its height at the shift, between the voxels, without a unit: that of the Gaussian that gave the sub-voxel
            offset. The same peak half a voxel off along all axes has half the value, and still its top.
        psr: peak-to-sidelobe ratio, (top - mean) / std; 0 where std is 0.
        neighborhood: (3, 3, 3) float32, the correlation around the voxel, cyclic.
        mean, std: of the whole correlation, without a unit.
    """

    index: np.ndarray
    shift: np.ndarray
    value: float
    top: float
    psr: float
    neighborhood: np.ndarray
    mean: float
    std: float


def fit_peaks(
    index: np.ndarray, cubes: np.ndarray, shape: tuple[int, ...], mean: float | np.ndarray, std: float | np.ndarray
) -> list[Peak]:
    """The peaks at voxels (m, 3) of a cyclic correlation, or of several of the same shape.

    Args:
        cubes: (m, 3, 3, 3) float32, their neighborhoods.
        shape: of the correlation.
        mean, std: of the whole correlation, without a unit; (m,) of each peak's.
    """
    values = cubes[:, 1, 1, 1].astype(np.float64)
    lines = np.stack([cubes[:, :, 1, 1], cubes[:, 1, :, 1], cubes[:, 1, 1, :]], axis=1)
    offsets, heights = _fit_gaussians(lines)
    flat = np.array(shape) <= 2
    offsets[:, flat] = heights[:, flat] = 0.0
    shifts, tops = signed(index, np.array(shape)) + offsets, values * np.exp(heights.sum(axis=1))
    means, stds = (np.broadcast_to(np.asarray(each, np.float64), tops.shape) for each in (mean, std))
    ratios = np.divide(tops - means, stds, out=np.zeros(len(tops)), where=stds > 0)
    numbers = np.column_stack([values, tops, ratios, means, stds]).tolist()
    return [
        Peak(place, shift, value, top, psr, cube, its_mean, its_std)
        for place, shift, cube, (value, top, psr, its_mean, its_std) in zip(index, shifts, cubes, numbers, strict=True)
    ]


def _fit_gaussians(lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The Gaussians through three values (..., 3), the middle one the largest: where their peaks lie, -0.5..0.5, and
    the logarithms of their heights over the middle values; 0 where there is none."""
    middle = lines[..., 1:2].astype(np.float64)
    shares = np.divide(lines, middle, out=np.ones(lines.shape), where=middle > 0)
    logarithms = np.log(np.maximum(shares, _FLOOR))
    left, right = logarithms[..., 0], logarithms[..., 2]
    curvature = left + right
    offset = np.divide(left - right, 2 * curvature, out=np.zeros(curvature.shape), where=curvature < 0)
    offset = np.clip(offset, -0.5, 0.5)
    return offset, -0.5 * curvature * offset**2


def signed(index: np.ndarray, n: int | np.ndarray) -> np.ndarray:
    """A cyclic index as -n/2..n/2."""
    return np.where(index < (np.asarray(n) + 1) // 2, index, index - n)
