"""KITTI trajectories: one pose per line, the upper 3 x 4 of its matrix row by row; no stamps."""

from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.tools.files.writers.atomic import atomic_path

if TYPE_CHECKING:
    from sonarmap.slam.graph.trajectory import Trajectory


def write_kitti(path: Path, trajectory: "Trajectory") -> None:
    """Write T_world_sensor with every digit that float64 has; the format has no place for stamps."""
    rows = trajectory.T_world_sensor.as_matrix()[:, :3].reshape(-1, 12)
    with atomic_path(path) as temporary:
        temporary.write_text("".join(" ".join(f"{number:.17g}" for number in row) + "\n" for row in rows.tolist()))
