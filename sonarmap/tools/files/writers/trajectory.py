"""Trajectories to TUM files, a pose per line as `stamp tx ty tz qx qy qz qw`, with every digit that float64 has."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.tools.files.writers.atomic import atomic_path

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from sonarmap.slam.graph.trajectory import Trajectory

HEADER = "# stamp [s] tx ty tz [m] qx qy qz qw: T_world_sensor\n"


def write_tum(path: Path, trajectory: "Trajectory") -> None:
    """Write T_world_sensor and the stamps."""
    poses = (" ".join(f"{x:.17g}" for x in pose) for pose in pose_numbers(trajectory.T_world_sensor).tolist())
    # repr is the shortest text that reads back as the same float64: microseconds of today's epoch seconds survive
    rows = [f"{stamp!r} {pose}\n" for stamp, pose in zip(trajectory.stamps.tolist(), poses, strict=True)]
    with atomic_path(path) as temporary:
        temporary.write_text("".join([HEADER, *rows]))


def pose_numbers(T: "RigidTransform") -> np.ndarray:
    """(N, 7) float64: x y z [m] and the quaternion x y z w, w >= 0, of N transforms."""
    return np.hstack([T.translation, T.rotation.as_quat(canonical=True)])
