"""TUM trajectories: one pose per line, `stamp tx ty tz qx qy qz qw`, '#' begins a comment."""

from pathlib import Path

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.poses.pose_rows import finite_rows, read_lines, transforms

LAYOUT = "stamp tx ty tz qx qy qz qw"


def read_tum(path: Path) -> Trajectory:
    """A trajectory, its stamps in seconds and its poses as T_world_sensor in meters."""
    lines = read_lines(path)
    rows = finite_rows(path, lines, LAYOUT)
    return Trajectory(rows[:, 0].copy(), transforms(path, lines, rows[:, 1:]))
