"""A peak of a correlation, with the Gaussian that tells its place and height between the voxels."""

from dataclasses import dataclass

import numpy as np

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


def fit_peak(index: np.ndarray, cube: np.ndarray, shape: tuple[int, ...], mean: float, std: float) -> Peak:
    """The peak at a voxel (3,) of a cyclic correlation, from its neighborhood (3, 3, 3), its mean and deviation."""
    value = float(cube[1, 1, 1])
    lines = zip((cube[:, 1, 1], cube[1, :, 1], cube[1, 1, :]), shape, strict=True)
    fits = np.array([_fit_gaussian(line) if n > 2 else (0.0, 0.0) for line, n in lines])
    top = value * float(np.exp(fits[:, 1].sum()))
    return Peak(
        index=index,
        shift=signed(index, np.array(shape)) + fits[:, 0],
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


def signed(index: np.ndarray, n: int | np.ndarray) -> np.ndarray:
    """A cyclic index as -n/2..n/2."""
    return np.where(index < (np.asarray(n) + 1) // 2, index, index - n)
