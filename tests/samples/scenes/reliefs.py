"""A rough ground seen from above: scans with a viewpoint, of parts of one place, for tests of the registration."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

# Edge of a block of the ground, and greatest height of a block [m].
_BLOCK, _HIGHEST = 2.0, 4.0
# Half of the ground's edge [m].
_HALF = 32.0


def relief(seed: int, count: int = 90_000) -> np.ndarray:
    """Points (count, 3) float64 [m] on the tops of blocks of any height, 64 m across, the ground at z = 0."""
    rng = np.random.default_rng(seed)
    blocks = round(2 * _HALF / _BLOCK)
    heights = rng.uniform(0, _HIGHEST, (blocks, blocks))
    places = rng.uniform(-_HALF, _HALF, (count, 2))
    i, j = np.floor((places + _HALF) / _BLOCK).astype(int).T
    return np.column_stack([places, heights[i, j] + rng.normal(0, 0.03, count)])


def seen(place: np.ndarray, T_world_sensor: RigidTransform, reach: float = 12.0) -> np.ndarray:
    """Points of a place within `reach` [m] of the sensor along x and y, (n, 3) float32, sensor frame."""
    off = np.abs(place[:, :2] - T_world_sensor.translation[:2]).max(axis=1)
    return T_world_sensor.inv().apply(place[off < reach]).astype(np.float32)


def above(x: float, y: float, z: float, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> RigidTransform:
    """T_world_sensor [m, deg]."""
    return RigidTransform.from_components([x, y, z], Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True))


HERE, THERE = above(0, 0, 12), above(3, -2, 13, 25, 4, -7)
T_TRUE = HERE.inv() * THERE
