"""Trajectories of TUM or KITTI, told apart by what the file holds.

TUM has one pose per line, `stamp tx ty tz qx qy qz qw`, KITTI the upper 3 x 4 of its matrix row by row; no stamps.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Slerp

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.poses.pose_rows import (
    ORTHONORMAL,
    finite_rows,
    read_lines,
    rotation_faults,
    transforms,
)

LAYOUT = "stamp tx ty tz qx qy qz qw"  # of TUM
_KITTI = "r11 r12 r13 tx r21 r22 r23 ty r31 r32 r33 tz"


def read_pair(estimate: Path, *truths: Path) -> tuple[Trajectory, Trajectory]:
    """The trajectories of one map's estimate and of its truth, whose poses belong together: by stamp in TUM files, by
    line in KITTI files (of that suffix, or of twelve columns). The truth is one file, or one for each dive in the map's
    order, see `in_order`. Raises InputError: naming the file and the line that is not as it should be; or only one of
    the two has stamps."""
    stamped = not _is_kitti(estimate)
    for truth in truths:
        if stamped == _is_kitti(truth):
            with_stamps, without = (estimate, truth) if stamped else (truth, estimate)
            raise InputError(
                f"{without} is a KITTI file, whose poses have no stamps, and {with_stamps} is none, so it is unknown "
                "which poses belong together. Give two files of one format."
            )
    read = read_tum if stamped else read_kitti
    return read(estimate), in_order([read(truth) for truth in truths])


def in_order(trajectories: Sequence[Trajectory]) -> Trajectory:
    """One trajectory after the other, in one world. Stamps that only count, 0, 1, 2, ... in every one of them, are
    counted on, as the scans of files without times are over all of a map's input; others stay as they are."""
    stamps = [trajectory.stamps for trajectory in trajectories]
    if all(np.array_equal(own, np.arange(len(own))) for own in stamps):
        stamps = [np.arange(sum(map(len, stamps)), dtype=np.float64)]
    poses = RigidTransform.concatenate([trajectory.T_world_sensor for trajectory in trajectories])
    return Trajectory(np.concatenate(stamps), poses)


def places_at(trajectory: Trajectory, times: np.ndarray) -> np.ndarray:
    """(N, 3) places [m] at times (N,) [s] between those of a trajectory."""
    places = trajectory.T_world_sensor.translation
    return np.column_stack([np.interp(times, trajectory.stamps, places[:, axis]) for axis in range(3)])


def poses_at(trajectory: Trajectory, times: np.ndarray) -> RigidTransform:
    """(N,) T_world_sensor at times (N,) [s] between those of a trajectory of two poses or more."""
    turns = Slerp(trajectory.stamps, trajectory.T_world_sensor.rotation)(times)
    return RigidTransform.from_components(places_at(trajectory, times), turns)


def _is_kitti(path: Path) -> bool:
    return path.suffix.lower() == ".kitti" or len(read_lines(path)[0][1].split()) == len(_KITTI.split())


def read_kitti(path: Path) -> Trajectory:
    """A trajectory of T_world_sensor in meters; its stamps count from 0. The nearest rotation is taken."""
    lines = read_lines(path)
    matrices = np.tile(np.eye(4), (len(lines), 1, 1))
    matrices[:, :3] = finite_rows(path, lines, _KITTI).reshape(-1, 3, 4)
    R = matrices[:, :3, :3]
    off, determinant = rotation_faults(R)
    bad = np.flatnonzero((off > ORTHONORMAL) | (determinant < 0))
    if len(bad):
        raise InputError(
            f"{path}: line {lines[bad[0]][0]} holds no rotation (R R^T is off by {off[bad[0]]:.2g}, "
            f"determinant {determinant[bad[0]]:.3f}); wanted {_KITTI}"
        )
    return Trajectory(np.arange(len(lines), dtype=np.float64), RigidTransform.from_matrix(matrices))


def read_tum(path: Path) -> Trajectory:
    """A trajectory, its stamps in seconds and its poses as T_world_sensor in meters."""
    lines = read_lines(path)
    rows = finite_rows(path, lines, LAYOUT)
    return Trajectory(rows[:, 0].copy(), transforms(path, lines, rows[:, 1:]))
