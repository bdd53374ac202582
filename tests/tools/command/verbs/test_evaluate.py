"""`sonarmap evaluate` end to end: its table, its limits, and the formats that it reads."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.writers.poses import write_tum
from tests.samples.clutter_scans import printed, refused, said, sonarmap

STAMPS = 5.0 + np.arange(4)
TRUTH = Trajectory(
    STAMPS,
    RigidTransform.from_components(
        np.outer(np.arange(4.0), [3.0, -1.5, 0.25]), Rotation.from_euler("ZYX", [[70, 2, 1]] * 4, degrees=True)
    ),
)
# Pose 2 is 0.4 m off along its own x axis and turned by 3 degrees.
SLIP = RigidTransform.from_components([0.4, 0, 0], Rotation.from_euler("z", 3, degrees=True))
ESTIMATE = Trajectory(
    STAMPS, RigidTransform.concatenate([T * SLIP if k == 2 else T for k, T in enumerate(TRUTH.T_world_sensor)])
)


@pytest.fixture
def pair(tmp_path: Path) -> list[Path]:
    write_tum(tmp_path / "estimate.tum", ESTIMATE)
    write_tum(tmp_path / "truth.tum", TRUTH)
    return [tmp_path / "estimate.tum", tmp_path / "truth.tum"]


def evaluated(*arguments: str | Path) -> dict[str, Any]:
    return printed(sonarmap("evaluate", *arguments, "--json"))


def test_align_first_warns_that_an_error_of_the_first_pose_moves_all(tmp_path: Path, pair: list[Path]) -> None:
    turned = RigidTransform.concatenate([TRUTH.T_world_sensor[0] * SLIP, *TRUTH.T_world_sensor[1:]])
    write_tum(tmp_path / "turned.tum", Trajectory(STAMPS, turned))
    ates = [evaluated(tmp_path / "turned.tum", pair[1], "--align", how)["ate_m"]["rms"] for how in ("first", "poses")]
    assert ates[0] > 2 * ates[1]
    shown = " ".join(sonarmap("evaluate", tmp_path / "turned.tum", pair[1], "--align", "first").stdout.split())
    assert f"{ates[0]:.3f} m (ATE" in shown
    assert "whose error moves and turns all others; all poses, the default, fit closest" in shown
    assert "moves and turns" not in sonarmap("evaluate", *pair).stdout


@pytest.mark.parametrize(
    ("limits", "code"),
    [
        (["--max-error-m", "0.41", "--max-error-deg", "3.1"], 0),
        (["--max-error-m", "0.39"], 3),
        (["--max-error-deg", "2.9"], 3),
        (["--max-error-deg", "nan"], 2),
    ],
)
def test_limits_name_the_pose_that_exceeds_them(pair: list[Path], limits: list[str], code: int) -> None:
    result = sonarmap("evaluate", *pair, "--align", "first", *limits)
    assert result.exit_code == code
    if code == 3:
        said(result, "the pose at 7 s is 0.400 m and 3.00 degrees off", f"{limits[-1]} ")
        assert result.stderr.count("error: ") == 1


@pytest.mark.parametrize("suffix", [".kitti", ".txt"])
def test_kitti_files_are_compared_line_by_line(tmp_path: Path, pair: list[Path], suffix: str) -> None:
    files = [tmp_path / f"{name}{suffix}" for name in ("estimate", "truth")]
    for path, trajectory in zip(files, (ESTIMATE, TRUTH), strict=True):
        np.savetxt(path, trajectory.T_world_sensor.as_matrix()[:, :3].reshape(-1, 12), fmt="%.17g")
    by_line = evaluated(*files)
    assert [pose["stamp"] for pose in by_line["per_pose"]] == [0, 1, 2, 3]
    assert by_line["ate_m"]["rms"] == pytest.approx(evaluated(*pair)["ate_m"]["rms"], rel=1e-9)
    refused(sonarmap("evaluate", pair[0], files[1]), f"{files[1]} is a KITTI file", "give one format")


def test_numbered_truths_of_several_dives_are_concatenated(tmp_path: Path) -> None:
    """A map of two dives stamps their scans 0 to 3; the truth of each dive counts from 0."""
    poses = TRUTH.T_world_sensor
    write_tum(tmp_path / "estimate.tum", Trajectory(np.arange(4.0), ESTIMATE.T_world_sensor))
    write_tum(tmp_path / "a.tum", Trajectory(np.arange(3.0), poses[:3]))
    write_tum(tmp_path / "b.tum", Trajectory(np.arange(1.0), poses[3:]))
    joined = [tmp_path / name for name in ("estimate.tum", "a.tum", "b.tum")]
    rows = evaluated(*joined, "--align", "first")["per_pose"]
    assert [row["stamp"] for row in rows] == [0, 1, 2, 3]
    assert [row["translation_m"] for row in rows] == pytest.approx([0, 0, 0.4, 0], abs=1e-9)


def test_truths_with_times_are_matched_by_time(tmp_path: Path, pair: list[Path]) -> None:
    poses = TRUTH.T_world_sensor
    write_tum(tmp_path / "a.tum", Trajectory(STAMPS[2:], poses[2:]))
    write_tum(tmp_path / "b.tum", Trajectory(STAMPS[:2], poses[:2]))
    parts, whole = evaluated(pair[0], tmp_path / "a.tum", tmp_path / "b.tum"), evaluated(*pair)
    assert parts["ate_m"]["rms"] == pytest.approx(whole["ate_m"]["rms"], rel=1e-9)
