"""Noise in the volume itself: voxels swapped between occupied and void, the paper's D0 to D6 (Sect. 3)."""

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from sonarmap.kernels.errors import InputError


@dataclass(frozen=True, slots=True)
class VoxelNoise:
    """Uniform noise of a volume (paper Sect. 3, Fig. 11).

    Attributes:
        swap: share of the region's voxels that are flipped, 0..1.
        envelope: how far around the structure the region reaches [voxels]; None: the whole grid.
    """

    swap: float
    envelope: int | None

    def __post_init__(self) -> None:
        if not 0 <= self.swap <= 1:
            raise InputError(f"voxel noise: swap is {self.swap}; wanted a share of the voxels, 0 <= swap <= 1")
        if self.envelope is not None and self.envelope < 0:
            raise InputError(f"voxel noise: the envelope is {self.envelope} voxels; wanted >= 0, or None for all")


# The paper's list, Sect. 3: the envelope's two widths and the whole grid, each at two swap ratios
NOISES: MappingProxyType[str, VoxelNoise] = MappingProxyType(
    {
        "D0": VoxelNoise(0.0, 0),
        "D1": VoxelNoise(1 / 100, 5),
        "D2": VoxelNoise(1 / 25, 5),
        "D3": VoxelNoise(1 / 100, 10),
        "D4": VoxelNoise(1 / 25, 10),
        "D5": VoxelNoise(1 / 100, None),
        "D6": VoxelNoise(1 / 25, None),
    }
)


def swap(occupied: np.ndarray, noise: VoxelNoise, rng: np.random.Generator) -> np.ndarray:
    """A copy of a volume in which a share of the voxels became void where occupied, occupied where void.

    "1 out of 25 voxel is flipped" (paper Sect. 3) is read by its word: exactly round(swap * region) different
    voxels of the region flip, all choices being equally likely, whether occupied or void.

    Args:
        occupied: (N, N, N) bool, occupied[ix, iy, iz]; the edges may also differ. It is left as it is.
        noise: how many and where; NOISES holds the paper's.
        rng: decides which.

    Returns:
        (N, N, N) bool.

    Raises:
        InputError: no boolean volume of three axes.
    """
    reached = envelope(occupied, noise.envelope)
    noisy = np.ascontiguousarray(occupied).copy()
    places = None if reached.all() else np.flatnonzero(reached)
    count = reached.size if places is None else len(places)
    chosen = rng.choice(count, round(noise.swap * count), replace=False, shuffle=False)
    noisy.reshape(-1)[chosen if places is None else places[chosen]] ^= True
    return noisy


def envelope(occupied: np.ndarray, margin: int | None) -> np.ndarray:
    """The structure and what lies within `margin` voxels of it.

    The distance is the largest of the three index differences (Chebyshev): every occupied voxel brings the cube
    of 2 margin + 1 voxels about it. The grid's faces end it; nothing wraps around.

    Args:
        occupied: (N, N, N) bool; the edges may also differ.
        margin: [voxels], >= 0; None: everywhere, though nothing be occupied.

    Returns:
        (N, N, N) bool, a new array.

    Raises:
        InputError: no boolean volume of three axes.
    """
    if occupied.dtype != bool or occupied.ndim != 3:
        raise InputError(
            f"a volume of {occupied.dtype} and shape {occupied.shape} cannot take voxel noise; wanted bool (N, N, N)"
        )
    if margin is None:
        return np.ones(occupied.shape, bool)
    grown = np.ascontiguousarray(occupied).copy()
    for axis in range(3):
        _grow(grown, axis, margin)
    return grown


def _grow(grown: np.ndarray, axis: int, margin: int) -> None:
    """Dilate along one axis in place: runs of 1, 2, 4.. voxels, so that few passes reach the whole margin."""
    along = np.moveaxis(grown, axis, 0)
    left = min(margin, len(along) - 1)
    reach = 1
    while left > 0:
        step = min(reach, left)
        before = along.copy()
        along[step:] |= before[:-step]
        along[:-step] |= before[step:]
        left -= step
        reach += step
