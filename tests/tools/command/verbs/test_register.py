"""`sonarmap register` end to end: what it prints and writes, and its exit codes."""

import json
import re
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.grid import Grid
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.method import ConfiguredMethod
from sonarmap.tools.command.verbs.register import _as_json, moved_scan, print_registration, write_moved
from sonarmap.tools.files.readers.scans import read_scan
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.files.writers.tables import to_json
from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.methods.registry import Setup
from tests.samples.clutter_scans import T_WORLD_SENSOR, done, files_in, printed, refused, said, scan, sonarmap, write
from tests.samples.surveys import KnowingRegistrar

GRID, CUBE = ("--grid", "64"), Grid(64, 0.5)
T_TRUE = T_WORLD_SENSOR[0].inv() * T_WORLD_SENSOR[1]


def as_json(*arguments: str | Path) -> dict[str, Any]:
    """JSON that `register` prints for two scans on the small grid."""
    return printed(sonarmap("register", *arguments, *GRID, "--json"))


def check_transform(found: dict[str, Any]) -> None:
    """Within a degree and a voxel of the truth."""
    assert pair_error(RigidTransform.from_matrix(found["T_target_source"]), T_TRUE).within(1.0, found["voxel"])


def test_an_accepted_pair_as_json(pair: list[str]) -> None:
    begun = perf_counter()
    result = sonarmap("register", *pair, *GRID, "--json")
    taken = perf_counter() - begun
    found = printed(result)
    assert result.stderr == ""
    assert (found["accepted"], found["grid"]) == (True, 64)
    check_transform(found)
    covariance = np.array(found["covariance"])
    assert covariance.shape == (6, 6)
    assert np.linalg.eigvalsh(covariance).min() > 0
    assert found["psr"] > 30
    assert 0 < found["overlap"] <= 1
    assert 0 < found["seconds"] < taken
    assert 0.9 <= found["probability"] <= 1
    for other in found["alternatives"]:
        assert other.keys() == {"T_target_source", "covariance", "probability", "psr", "overlap"}
        assert other["probability"] <= found["probability"]
    paper = as_json(*pair, "--method", "hemisphere")
    assert (paper["probability"], paper["alternatives"]) == (None, [])


def test_alternatives_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    def result_at(x: float, probability: float, *others: Registration) -> Registration:
        T = RigidTransform.from_translation([x, 0, 0])
        return Registration(T, np.eye(6), 50.0, 0.5, True, 0.1, "so", probability, alternatives=others)

    chosen = ConfiguredMethod("spectral", KnowingRegistrar(T_WORLD_SENSOR, np.eye(6)), CUBE, Setup(CUBE))
    found = result_at(1, 0.934, result_at(2, 0.05), result_at(3, float("nan")))
    listed: dict[str, Any] = to_json(_as_json(found, chosen))
    assert listed["probability"] == 0.934
    others = listed["alternatives"]
    assert [(other["T_target_source"][0][3], other["probability"]) for other in others] == [(2, 0.05), (3, None)]
    print_registration(found, chosen)
    shown = " ".join(capsys.readouterr().out.split())
    assert "right with a probability of 93.4%" in shown
    assert "2 transforms could not be excluded" in shown
    print_registration(replace(found, probability=float("nan"), accepted=False), chosen)
    refusal = capsys.readouterr().out
    assert refusal.startswith("NO RELIABLE REGISTRATION")
    assert "probab" not in refusal


def test_an_accepted_pair_in_words(pair: list[str]) -> None:
    result = sonarmap("register", *pair, *GRID)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.startswith("Registered: this transform is right with a probability of")
    # the truth: 1.5 m forward, 0.8 m right, 0.3 m up; yaw +14, pitch +3 (nose down), roll -5 (left side down)
    assert re.search(r"x 1\.[45]\d\d m forward, y -0\.[78]\d\d m left, z 0\.[23]\d\d m up", result.stdout)
    assert re.search(
        r"yaw 1[345]\.\d\d° left, pitch [234]\.\d\d° nose down, roll -[456]\.\d\d° right side", result.stdout
    )


def test_scans_of_different_places_are_refused_and_not_written(tmp_path: Path) -> None:
    pair = write(tmp_path, here=scan(0, scene=1), there=scan(0, scene=2))
    result = sonarmap("register", *pair, *GRID, "--json", "-o", tmp_path / "moved.ply")
    found = printed(result, 3)
    assert found["reason"]
    assert (found["accepted"], "written" in found) == (False, False)
    assert result.stderr == f"warning: {tmp_path / 'moved.ply'} is not written, as the registration is not reliable\n"
    assert set(files_in(tmp_path)) == {"here.ply", "there.ply"}


def test_nonfinite_points_are_dropped_with_a_warning_on_stderr(tmp_path: Path) -> None:
    source = scan(1)
    source[::7, 0] = np.nan
    source[3::50, 2] = -np.inf
    bad = int((~np.isfinite(source).all(axis=1)).sum())
    pair = write(tmp_path, target=scan(0), source=source)
    result = sonarmap("register", *pair, *GRID, "--json")
    check_transform(printed(result))
    said(result, "source.ply", f"dropped {bad:,} of 7,200 points that are NaN or infinite")


def test_the_uncertainty_of_the_worst_direction_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    """Semi-axes of 0.3, 0.1 and 0.1 m, oblique to the coordinate axes; along none of these is sigma 0.3 m."""
    turn = Rotation.from_euler("ZYX", [40, 30, 20], degrees=True).as_matrix()
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = turn @ np.diag(np.deg2rad([2.0, 0.5, 0.5]) ** 2) @ turn.T
    covariance[3:, 3:] = turn @ np.diag([0.3, 0.1, 0.1]) ** 2 @ turn.T
    found = Registration(RigidTransform.identity(), covariance, psr=50.0, overlap=0.5, accepted=True, seconds=0.1)
    print_registration(
        found, ConfiguredMethod("spectral", KnowingRegistrar(T_WORLD_SENSOR, covariance), CUBE, Setup(CUBE))
    )
    assert "0.300 m and 2.00° in the worst direction" in capsys.readouterr().out


def test_missing_strengths_are_refused_or_reported(pair: list[str], tmp_path: Path) -> None:
    refused(
        sonarmap("register", *pair, *GRID, "--set", "use_strength=true"), "no scan has echo strengths", "leave it out"
    )
    write_ply(tmp_path / "strong.ply", scan(1), {"intensity": np.linspace(0, 1, 7200)})
    mixed = done(sonarmap("register", pair[0], tmp_path / "strong.ply", *GRID, "--set", "use_strength=true"))
    said(mixed, "1 of 2 scans have no echo strength")


@pytest.fixture
def strong_pair(tmp_path: Path) -> list[str]:
    """Two scans of one scene, the second with strengths."""
    target = write(tmp_path, target=scan(0))
    write_ply(tmp_path / "source.ply", scan(1), {"intensity": np.linspace(0, 1, 7200, dtype=np.float32)})
    return [*target, str(tmp_path / "source.ply")]


def test_the_written_scan_is_moved_by_the_printed_transform(strong_pair: list[str], tmp_path: Path) -> None:
    moved = tmp_path / "sub" / "moved.PLY"
    printed = json.loads(sonarmap("register", *strong_pair, *GRID, "--json", "-o", moved).stdout)
    assert printed["written"] == str(moved)
    T = np.array(printed["T_target_source"])
    read = read_scan(moved)
    np.testing.assert_allclose(read.points, scan(1) @ T[:3, :3].T + T[:3, 3], atol=1e-5)
    # scan(0) and scan(1) are the same points, in the same order, in their own frames
    assert np.linalg.norm(read.points - scan(0), axis=1).max() < 0.5
    np.testing.assert_array_equal(read.strength, np.linspace(0, 1, 7200, dtype=np.float32))
    assert "written" not in json.loads(sonarmap("register", *strong_pair, *GRID, "--json").stdout)


def test_viewpoints_move_with_the_points(tmp_path: Path) -> None:
    """By hand: a quarter turn to the left, then 10 m forward, 20 m left, 30 m up; (1, 2, 3) becomes (8, 21, 33)."""
    T = RigidTransform.from_components([10, 20, 30], Rotation.from_euler("z", 90, degrees=True))
    seen = Scan(np.array([[1, 2, 3]], np.float32), None, viewpoints=np.array([[0, -1, 0.5]], np.float32))
    moved = moved_scan(seen, T)
    np.testing.assert_allclose(moved.points, [[8, 21, 33]], atol=1e-5)
    assert moved.viewpoints is not None
    np.testing.assert_allclose(moved.viewpoints, [[11, 20, 30.5]], atol=1e-5)
    write_moved(tmp_path / "moved.ply", seen, T)
    read = read_scan(tmp_path / "moved.ply")
    assert read.viewpoints is not None
    np.testing.assert_allclose(read.viewpoints, [[11, 20, 30.5]], atol=1e-5)
    assert read.strength is None


def test_unsupported_output_formats_are_refused_at_once(tmp_path: Path) -> None:
    result = sonarmap("register", "missing.ply", "missing.ply", "-o", tmp_path / "moved.xyz")
    refused(result, "moved.xyz", "give a name that ends in .ply, as in -o moved.ply")


def test_unwritable_outputs_are_refused_and_inputs_are_kept(strong_pair: list[str], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "linked.ply").symlink_to(strong_pair[0])
    before, replaces = files_in(tmp_path), ("error: ", "would replace", "give another name")
    names = dict.fromkeys(("target.ply", "source.ply", "linked.ply"), replaces)
    for name, words in {**names, "file/moved.ply": ("error: cannot write ",)}.items():
        result = sonarmap("register", *strong_pair, *GRID, "-o", tmp_path / name)
        assert result.stdout == ""
        refused(result, *words)
    assert files_in(tmp_path) == before
    assert (tmp_path / "linked.ply").is_symlink()
