"""KITTI trajectories: one pose per line, the upper 3 x 4 of its matrix row by row; no stamps."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.poses.matrices import ORTHONORMAL, rotation_faults
from sonarmap.tools.files.readers.poses.pose_rows import finite_rows, read_lines

LAYOUT = "r11 r12 r13 tx r21 r22 r23 ty r31 r32 r33 tz"


def read_kitti(path: Path) -> Trajectory:
    """A trajectory of T_world_sensor in meters; its stamps count from 0. The nearest rotation is taken."""
    lines = read_lines(path)
    matrices = np.tile(np.eye(4), (len(lines), 1, 1))
    matrices[:, :3] = finite_rows(path, lines, LAYOUT).reshape(-1, 3, 4)
    R = matrices[:, :3, :3]
    off, determinant = rotation_faults(R)
    bad = np.flatnonzero((off > ORTHONORMAL) | (determinant < 0))
    if len(bad):
        raise InputError(
            f"{path}: line {lines[bad[0]][0]} holds no rotation (R R^T is off by {off[bad[0]]:.2g}, "
            f"determinant {determinant[bad[0]]:.3f}); wanted {LAYOUT}"
        )
    return Trajectory(np.arange(len(lines), dtype=np.float64), RigidTransform.from_matrix(matrices))
