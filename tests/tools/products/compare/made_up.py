"""Synthetic surveys of a bed, each of several scans with pose errors."""

import numpy as np
from scipy.linalg import block_diag

from sonarmap.tools.products.compare.detection import Distances, distances_between
from sonarmap.tools.products.compare.surface import Epoch, levers

VOXEL = 0.5
NOISE = 0.05  # [m]
SCANS = 4
ALIGNMENT = np.diag(np.repeat([1e-3, 0.02], 3) ** 2)
_SIGMAS = np.repeat([2e-3, 0.03], 3)  # of poses [rad, m]


def compared(old: Epoch, new: Epoch) -> Distances:
    return distances_between(old, new, ALIGNMENT, VOXEL, 4 * VOXEL, 2 * VOXEL)


def bed(flat: np.ndarray) -> np.ndarray:
    """Heights (N,) [m] of the bed at positions (N, 2) [m]."""
    return 0.3 * np.sin(flat[:, 0] / 4) + 0.2 * np.cos(flat[:, 1] / 5)


def surveyed(
    seed: int,
    change: float = 0.0,
    half: float = 3.0,
    size: float = 15.0,
    poses_err: bool = True,
    weight: float | None = None,
) -> Epoch:
    """Square of the bed up to `size` [m] from its center, seen in one strip per scan; `change` [m] is added to the
    heights within `half` [m] of the center."""
    rng = np.random.default_rng(seed)
    axis = np.arange(-size, size, VOXEL) + VOXEL / 2
    flat = np.stack(np.meshgrid(axis, axis, indexing="ij"), -1).reshape(-1, 2)
    flat = np.repeat(flat, 2, axis=0)
    flat += rng.uniform(-VOXEL / 2, VOXEL / 2, flat.shape)
    inside = (np.abs(flat) < half).all(axis=1)
    z = bed(flat) + change * inside + rng.normal(0, NOISE, len(flat))
    points = np.column_stack([flat, z])
    scan = np.clip(((flat[:, 0] + size) / (2 * size) * SCANS).astype(np.int64), 0, SCANS - 1)
    origins = np.column_stack([np.linspace(-size, size, SCANS), np.zeros(SCANS), np.full(SCANS, 12.0)])
    C = np.diag(_SIGMAS**2)
    if poses_err:
        for k in range(SCANS):
            members = scan == k
            error = rng.normal(0, _SIGMAS)
            for axis_number, direction in enumerate(np.eye(3)):
                J = levers(points[members], np.broadcast_to(direction, (members.sum(), 3)))
                points[members, axis_number] += J @ error
    weights = np.full(len(points), weight) if weight else rng.integers(1, 9, len(points)).astype(float)
    return Epoch(
        points, np.full(len(points), NOISE), weights, scan, origins[scan], np.asarray(block_diag(*[C] * SCANS))
    )
