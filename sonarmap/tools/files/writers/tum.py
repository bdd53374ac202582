"""TUM trajectories: one pose per line, `stamp tx ty tz qx qy qz qw`."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.tools.files.writers.atomic import atomic_path

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from sonarmap.slam.graph.trajectory import Trajectory

HEADER = "# stamp [s] tx ty tz [m] qx qy qz qw: T_world_sensor\n"


def write_tum(path: Path, trajectory: "Trajectory") -> None:
    """Write every digit that float64 has: microseconds of today's epoch seconds survive."""
    poses = pose_numbers(trajectory.T_world_sensor)
    with atomic_path(path) as temporary:
        temporary.write_text(
            HEADER
            + "".join(
                # repr is the shortest text that reads back as the same float64
                f"{stamp!r} {' '.join(f'{number:.17g}' for number in pose)}\n"
                for stamp, pose in zip(trajectory.stamps.tolist(), poses.tolist(), strict=True)
            )
        )


def pose_numbers(T: "RigidTransform") -> np.ndarray:
    """(N, 7) float64: x y z [m] and the quaternion x y z w, w >= 0, of N transforms."""
    return np.hstack([T.translation, T.rotation.as_quat(canonical=True)])
