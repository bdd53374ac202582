"""Surfaces for tests: points of bent sheets and walls, one per voxel, and their elements by NumPy."""

import numpy as np

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.surface.cells import Elements, sort_into_cells


def bent_sheet(count: int, seed: int, extent: float = 25.0) -> np.ndarray:
    """(m, 3) [voxels]: at most `count` points of a bent sheet and of a wall across it, one per voxel."""
    u = np.random.default_rng(seed).uniform(-1, 1, (count, 3))
    sheet = np.column_stack([extent * u[:, 0], 0.7 * extent * u[:, 1], 3 * np.sin(2.2 * u[:, 0]) + 2 * u[:, 1] ** 2])
    wall = np.column_stack([0.6 * extent + 2 * u[:, 2], 0.7 * extent * u[:, 1], 6 * u[:, 0]])
    points = np.where(np.arange(count)[:, None] % 3 > 0, sheet, wall)
    return points[np.sort(np.unique(np.floor(points), axis=0, return_index=True)[1])].astype(np.float32)


def random_rows(points: np.ndarray, seed: int) -> np.ndarray:
    """(m, 12) float32 elements of the points, with random normals, rays, rims and directions."""
    rng = np.random.default_rng(seed)
    rows = np.zeros((len(points), 12), np.float32)
    normals = rng.normal(size=(len(points), 3))
    rows[:, :3], rows[:, 3] = points, rng.random(len(points)) < 0.8
    rows[:, 4:7], rows[:, 7] = normals / np.linalg.norm(normals, axis=1, keepdims=True), rng.integers(0, 5, len(points))
    rows[:, 8:11] = rng.normal(0, 10, (len(points), 3))
    return rows


def upload(device: Device, rows: np.ndarray) -> Elements:
    return Elements(device.to_device(rows), sort_into_cells(device, rows[:, :3]))
