"""A scene as a volume of voxels, the paper's "simulated structure" (Sect. 3, Fig. 11), shifted and turned whole."""

import numpy as np

from sonarmap.spectral.grid import Grid
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.shapes.solids import Mesh

_TRIANGLES_AT_ONCE = 20_000


def surface_points(mesh: Mesh, spacing: float) -> np.ndarray:
    """Points all over a surface, no farther apart than `spacing` [m], its height about zero.

    Every triangle carries the same raster as its neighbor of that size, corners and edges included: nothing random.

    Returns:
        (N, 3) float32 [m], frame of the scene, its lowest and highest points equally far from z = 0.
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
    """Which voxels of a grid about the origin hold a point; what lies outside is lost.

    Args:
        points: (N, 3) [m].

    Returns:
        (edge, edge, edge) bool; voxel i covers the coordinate (i - edge/2) voxel at its center.
    """
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
