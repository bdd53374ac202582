"""`sonarmap register --write`: the moved scan as a file."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.verbs.register import moved_scan, write_moved
from sonarmap.tools.files.readers.scans import read_scan
from sonarmap.tools.files.writers.points import write_ply
from tests.samples.clutter_scans import T_WORLD_SENSOR, done, files_in, refused, said, scan, sonarmap, write

GRID = ("--grid", "64")
T_TRUE = T_WORLD_SENSOR[0].inv() * T_WORLD_SENSOR[1]


@pytest.fixture
def pair(tmp_path: Path) -> list[str]:
    """Seen from two places, the second with strengths."""
    target = write(tmp_path, target=scan(0))
    write_ply(tmp_path / "source.ply", scan(1), {"intensity": np.linspace(0, 1, 7200, dtype=np.float32)})
    return [*target, str(tmp_path / "source.ply")]


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".PLY"])
def test_the_moved_scan_lies_on_the_target(pair: list[str], tmp_path: Path, suffix: str) -> None:
    moved = tmp_path / f"moved{suffix}"
    result = done(sonarmap("register", *pair, *GRID, "--write", moved))
    assert f"written to {moved}" in result.stdout
    read = read_scan(moved)
    # scan(0) and scan(1) are the same points, in the same order, in their own frames
    assert np.linalg.norm(read.points - scan(0), axis=1).max() < 0.5
    assert np.linalg.norm(read.points - scan(1), axis=1).max() > 2.0
    assert read.strength is not None
    np.testing.assert_array_equal(read.strength, np.linspace(0, 1, 7200, dtype=np.float32))


def test_it_is_moved_by_the_transform_that_is_printed(pair: list[str], tmp_path: Path) -> None:
    moved = tmp_path / "sub" / "moved.ply"
    printed = json.loads(sonarmap("register", *pair, *GRID, "--json", "--write", moved).stdout)
    assert printed["written"] == str(moved)
    T = np.array(printed["T_target_source"])
    np.testing.assert_allclose(read_scan(moved).points, scan(1) @ T[:3, :3].T + T[:3, 3], atol=1e-5)
    assert "written" not in json.loads(sonarmap("register", *pair, *GRID, "--json").stdout)


def test_viewpoints_move_with_the_points(tmp_path: Path) -> None:
    """By hand: a quarter turn to the left, then 10 m forward, 20 m left, 30 m up; (1, 2, 3) becomes (8, 21, 33)."""
    T = RigidTransform.from_components([10, 20, 30], Rotation.from_euler("z", 90, degrees=True))
    seen = Scan(np.array([[1, 2, 3]], np.float32), None, viewpoints=np.array([[0, -1, 0.5]], np.float32))
    moved = moved_scan(seen, T)
    np.testing.assert_allclose(moved.points, [[8, 21, 33]], atol=1e-5)
    assert moved.viewpoints is not None
    np.testing.assert_allclose(moved.viewpoints, [[11, 20, 30.5]], atol=1e-5)
    write_moved(tmp_path / "moved.pcd", seen, T)
    read = read_scan(tmp_path / "moved.pcd")
    assert read.viewpoints is not None
    np.testing.assert_allclose(read.viewpoints, [[11, 20, 30.5]], atol=1e-5)
    assert read.strength is None


def test_a_registration_that_is_not_reliable_moves_nothing(tmp_path: Path) -> None:
    pair = write(tmp_path, here=scan(0, scene=1), there=scan(0, scene=2))
    result = sonarmap("register", *pair, *GRID, "--json", "--write", tmp_path / "moved.ply")
    assert result.exit_code == 3
    assert "written" not in json.loads(result.stdout)
    said(result, "warning: ", "moved.ply is not written, as the registration is not reliable")
    assert set(files_in(tmp_path)) == {"here.ply", "there.ply"}


@pytest.mark.parametrize("name", ["moved.xyz", "moved", "moved.las"])
def test_a_format_that_is_not_written_is_refused_at_once(tmp_path: Path, name: str) -> None:
    result = sonarmap("register", "missing.ply", "missing.ply", "--write", tmp_path / name)
    assert result.stdout == ""
    refused(result, name, "give a name that ends in .ply or .pcd, as in --write moved.ply")


def test_what_cannot_be_written_is_refused_and_no_input_replaced(pair: list[str], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "linked.ply").symlink_to(pair[0])
    before, replaces = files_in(tmp_path), ("error: ", "would replace", "give another name")
    names = dict.fromkeys(("target.ply", "source.ply", "linked.ply"), replaces)
    for name, words in {**names, "file/moved.ply": ("error: cannot write ",)}.items():
        result = sonarmap("register", *pair, *GRID, "--write", tmp_path / name)
        assert result.stdout == ""
        refused(result, *words)
    assert files_in(tmp_path) == before
    assert (tmp_path / "linked.ply").is_symlink()
