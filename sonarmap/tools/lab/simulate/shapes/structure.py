"""A scene as a volume of voxels, the paper's "simulated structure" (Sect. 3, Fig. 11), shifted and turned whole."""

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.shapes.solids import Mesh

_TRIANGLES_AT_ONCE = 20_000


def surface_points(mesh: Mesh, spacing: float) -> np.ndarray:
    """Points all over a surface, no farther apart than `spacing` [m], its height about zero.

    Every triangle carries the same raster as its neighbor of that size, corners and edges included: nothing random.
    Returns (N, 3) float32 [m], frame of the scene, its lowest and highest points equally far from z = 0.
    """
    corners = mesh.vertices[mesh.triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.maximum(1, np.ceil(longest / spacing)).astype(int)
    points = []
    for count in np.unique(steps):
        alike = corners[steps == count]
        weights = _barycentric(int(count))
        for first in range(0, len(alike), _TRIANGLES_AT_ONCE):
            some = alike[first : first + _TRIANGLES_AT_ONCE]
            points.append((weights @ some).reshape(-1, 3).astype(np.float32))
    cloud = np.concatenate(points)
    cloud[:, 2] -= (cloud[:, 2].min() + cloud[:, 2].max()) / 2
    return cloud


def occupy(points: np.ndarray, grid: Grid) -> np.ndarray:
    """Which voxels of a grid about the origin hold one of `points` (N, 3) [m], (edge, edge, edge) bool; what lies
    outside is lost. Voxel i covers the coordinate (i - edge/2) voxel at its center."""
    cells = np.floor(points / grid.voxel + (grid.edge / 2 + 0.5)).astype(np.int64)
    inside = ((cells >= 0) & (cells < grid.edge)).all(axis=1)
    volume = np.zeros((grid.edge,) * 3, bool)
    volume[tuple(cells[inside].T)] = True
    return volume


def voxel_scan(occupied: np.ndarray, grid: Grid, name: str) -> Scan:
    """The occupied voxels' centers as a scan whose frame has its origin in the middle of the grid."""
    return Scan(((np.argwhere(occupied) - grid.edge / 2) * grid.voxel).astype(np.float32), name=name)


def _barycentric(count: int) -> np.ndarray:
    """(K, 3) weights of a triangle's corners, on a raster of `count` steps a side."""
    i, j = (steps.ravel() for steps in np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij"))
    within = i + j <= count
    first, second = i[within] / count, j[within] / count
    return np.column_stack([1 - first - second, first, second])


@dataclass(frozen=True, slots=True)
class VoxelNoise:
    """Uniform noise of a volume (paper Sect. 3, Fig. 11)."""

    swap: float  # share of the region's voxels that are flipped, 0..1
    envelope: int | None  # how far around the structure the region reaches [voxels]; None: the whole grid

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
    """A copy of a volume (N, N, N) bool in which a share of the voxels became void where occupied, occupied where void;
    the edges may also differ.

    "1 out of 25 voxel is flipped" (paper Sect. 3) is read by its word: exactly round(swap * region) different voxels of
    the region flip, all choices being equally likely. Raises InputError: no boolean volume of three axes.
    """
    reached = envelope(occupied, noise.envelope)
    noisy = np.ascontiguousarray(occupied).copy()
    places = None if reached.all() else np.flatnonzero(reached)
    count = reached.size if places is None else len(places)
    chosen = rng.choice(count, round(noise.swap * count), replace=False, shuffle=False)
    noisy.reshape(-1)[chosen if places is None else places[chosen]] ^= True
    return noisy


def envelope(occupied: np.ndarray, margin: int | None) -> np.ndarray:
    """The structure and what lies within `margin` voxels of it, a new (N, N, N) bool; None: everywhere.

    The distance is the largest of the three index differences (Chebyshev): every occupied voxel brings the cube of 2
    margin + 1 voxels about it. The grid's faces end it; nothing wraps around. Raises InputError: no boolean volume of
    three axes.
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
