"""Trajectories to files. A new format is a file here and a row of TRAJECTORY_WRITERS."""

from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.kitti import write_kitti
from sonarmap.tools.files.writers.tum import write_tum

if TYPE_CHECKING:
    from sonarmap.slam.graph.trajectory import Trajectory

TRAJECTORY_WRITERS = {".tum": write_tum, ".kitti": write_kitti}


def write_trajectory(path: Path, trajectory: "Trajectory") -> None:
    """Write T_world_sensor of every pose in the format that the suffix of `path` names. Raises InputError: an unknown
    suffix, or the file cannot be written."""
    suffix = path.suffix.lower()
    if suffix not in TRAJECTORY_WRITERS:
        known = ", ".join(TRAJECTORY_WRITERS)
        raise InputError(f"cannot write {path}: unknown format {suffix!r}; known formats are {known}")
    TRAJECTORY_WRITERS[suffix](path, trajectory)
