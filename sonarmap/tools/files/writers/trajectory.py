"""Trajectories to files, with every digit that float64 has. A new format is a row of TRAJECTORY_WRITERS.

TUM has one pose per line, `stamp tx ty tz qx qy qz qw`; KITTI the upper 3 x 4 of its matrix row by row; no stamps.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.atomic import atomic_path

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from sonarmap.slam.graph.trajectory import Trajectory

HEADER = "# stamp [s] tx ty tz [m] qx qy qz qw: T_world_sensor\n"  # of TUM


def write_trajectory(path: Path, trajectory: "Trajectory") -> None:
    """Write T_world_sensor of every pose in the format that the suffix of `path` names; InputError for another."""
    suffix = path.suffix.lower()
    if suffix not in TRAJECTORY_WRITERS:
        known = ", ".join(TRAJECTORY_WRITERS)
        raise InputError(f"cannot write {path}: unknown format {suffix!r}; known formats are {known}")
    TRAJECTORY_WRITERS[suffix](path, trajectory)


def write_tum(path: Path, trajectory: "Trajectory") -> None:
    """Write T_world_sensor and the stamps."""
    poses = map(_in_digits, pose_numbers(trajectory.T_world_sensor).tolist())
    # repr is the shortest text that reads back as the same float64: microseconds of today's epoch seconds survive
    rows = [f"{stamp!r} {pose}\n" for stamp, pose in zip(trajectory.stamps.tolist(), poses, strict=True)]
    with atomic_path(path) as temporary:
        temporary.write_text("".join([HEADER, *rows]))


def write_kitti(path: Path, trajectory: "Trajectory") -> None:
    """Write T_world_sensor."""
    rows = trajectory.T_world_sensor.as_matrix()[:, :3].reshape(-1, 12)
    with atomic_path(path) as temporary:
        temporary.write_text("".join(f"{_in_digits(row)}\n" for row in rows.tolist()))


TRAJECTORY_WRITERS = {".tum": write_tum, ".kitti": write_kitti}


def _in_digits(numbers: list[float]) -> str:
    return " ".join(f"{number:.17g}" for number in numbers)


def pose_numbers(T: "RigidTransform") -> np.ndarray:
    """(N, 7) float64: x y z [m] and the quaternion x y z w, w >= 0, of N transforms."""
    return np.hstack([T.translation, T.rotation.as_quat(canonical=True)])
