"""Trajectories in every format that is written come back, and `--also` offers what has a writer."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.map_folder.names import EXPORTS
from sonarmap.tools.files.readers.poses.trajectory import read_kitti
from sonarmap.tools.files.readers.poses.tum import read_tum
from sonarmap.tools.files.writers.trajectory import TRAJECTORY_WRITERS, write_trajectory
from tests.samples.surveys import random_transforms

READERS = {".tum": read_tum, ".kitti": read_kitti}


@pytest.mark.parametrize("suffix", TRAJECTORY_WRITERS)
def test_poses_come_back(tmp_path: Path, suffix: str) -> None:
    trajectory = Trajectory(np.arange(3.0), random_transforms(np.random.default_rng(4), 3))
    write_trajectory(tmp_path / f"poses{suffix}", trajectory)
    read = READERS[suffix](tmp_path / f"poses{suffix}")
    np.testing.assert_array_equal(read.stamps, trajectory.stamps)
    matrices = trajectory.T_world_sensor.as_matrix()
    np.testing.assert_allclose(read.T_world_sensor.as_matrix(), matrices, atol=1e-12)


def test_an_unknown_format_is_refused(tmp_path: Path) -> None:
    trajectory = Trajectory(np.arange(3.0), random_transforms(np.random.default_rng(4), 3))
    with pytest.raises(InputError, match=r"unknown format '\.csv'; known formats are \.tum, \.kitti"):
        write_trajectory(tmp_path / "poses.csv", trajectory)
    assert not list(tmp_path.iterdir())


def test_exports_are_what_has_a_writer_and_is_not_written_anyway() -> None:
    assert EXPORTS == {"pcd": "map{}.pcd", "kitti": "trajectory{}.kitti"}
