"""`sonarmap evaluate` with a map, a surface and a survey's summary."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from typer.testing import Result

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.files.writers.poses import write_tum
from sonarmap.tools.lab.evaluate.survey import read_summary
from tests.samples.clutter_scans import refused_with_reason, said, sonarmap

COUNT = 6
TRUTH = Trajectory(
    np.arange(float(COUNT)),
    RigidTransform.from_components(
        np.column_stack([3.0 * np.arange(COUNT), np.arange(COUNT) ** 2, np.zeros(COUNT)]),
        Rotation.from_euler("ZYX", np.outer(np.arange(COUNT), [17, 2, -3]), degrees=True),
    ),
)
WORLD = RigidTransform.from_components((-8.0, 4.0, 1.0), Rotation.from_euler("ZYX", (0.9, 0.1, -0.2)))
ESTIMATE = Trajectory(TRUTH.stamps, WORLD * TRUTH.T_world_sensor)
POINTS = np.random.default_rng(8).uniform(-10, 10, (500, 3))


HEADING = "target,source,role,kept,reason,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg"


def pair(i: int, j: int, role: str, kept: str, off_m: float | None = 0.0) -> str:
    """A row of pairs.csv that is wrong by `off_m` along x; with None, of a failed pair."""
    if off_m is None:
        return f"{i},{j},{role},{kept},failed,,,,,,"
    T = TRUTH.T_world_sensor[i].inv() * TRUTH.T_world_sensor[j] * RigidTransform.from_translation((off_m, 0, 0))
    yaw, pitch, roll = T.rotation.as_euler("ZYX", degrees=True).tolist()
    return ",".join(map(str, [i, j, role, kept, "told", *T.translation.tolist(), roll, pitch, yaw]))


PAIRS = [
    *(pair(k, k + 1, "sequential", "yes") for k in range(COUNT - 1)),
    pair(0, 4, "loop", "yes", 1.4),
    pair(0, 5, "loop", "no", 1.4),
    pair(1, 5, "bridge", "yes", 1.6),
    pair(2, 5, "loop", "no", None),
]


def write_pairs(folder: Path, *rows: str) -> None:
    (folder / "pairs.csv").write_text("\n".join([*rows, ""]))


def summary(covariances: bool) -> dict:
    """The keys of a survey's summary that an evaluation reads, and some that it does not."""
    rows = [{"index": k, "name": f"scan_{k}", "stamp": float(k), "sigmas": {}} for k in range(COUNT)]
    if covariances:
        rows = [row | {"covariance": ((1e-12 if k == 0 else 0.01) * np.eye(6)).tolist()} for k, row in enumerate(rows)]
    return {
        "settings": {"grid": {"edge": 128, "voxel": 0.5}},
        "scans": rows,
        "pairs": {"file": "pairs.csv", "tried": len(PAIRS), "kept": 7},
        "components": [{"scans": list(range(COUNT)), "map": {"points": 500, "voxel_m": 0.25}}],
        "graph": {"edges": 7},
    }


@pytest.fixture
def files(tmp_path: Path) -> Path:
    write_tum(tmp_path / "estimate.tum", ESTIMATE)
    write_tum(tmp_path / "truth.tum", TRUTH)
    write_ply(tmp_path / "truth.ply", POINTS)
    write_ply(tmp_path / "map.ply", WORLD.apply(POINTS + np.array([0.0, 0.2, 0.0])))
    (tmp_path / "summary.json").write_text(json.dumps(summary(covariances=True)))
    write_pairs(tmp_path, HEADING, *PAIRS)
    return tmp_path


def evaluated(folder: Path, *options: str) -> dict:
    result = sonarmap("evaluate", folder / "estimate.tum", folder / "truth.tum", *options, "--json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def with_summary(folder: Path) -> Result:
    return sonarmap("evaluate", folder / "estimate.tum", folder / "truth.tum", "--summary", folder / "summary.json")


@pytest.mark.parametrize("align", ["poses", "first"])
def test_a_map_is_aligned_like_its_trajectory(files: Path, align: str) -> None:
    options = ("--map", str(files / "map.ply"), "--surface", str(files / "truth.ply"), "--voxel", "0.3")
    scores = evaluated(files, *options, "--align", align)["map"]
    assert scores["median_m"] == pytest.approx(0.2, abs=1e-6)
    assert scores["p90_m"] == pytest.approx(0.2, abs=1e-6)
    assert (scores["within_voxel"], scores["voxel_m"], scores["nearest"]) == (1.0, 0.3, "point")
    assert scores["alignment"] == align
    by_summary = evaluated(files, *options[:4], "--summary", str(files / "summary.json"))["map"]
    assert (by_summary["within_voxel"], by_summary["voxel_m"]) == (1.0, 0.25)


def test_scans_without_truth_leave_their_pairs_unjudged(files: Path) -> None:
    write_tum(files / "truth.tum", TRUTH.take(range(5)))
    scores = evaluated(files, "--summary", str(files / "summary.json"))
    assert (scores["pairs"]["loops"]["unjudged"], scores["pairs"]["sequential"]["unjudged"]) == (2, 1)
    assert scores["uncertainty"]["poses"] == 4
    write_tum(files / "truth.tum", TRUTH.take(range(1, 6)))
    refused = with_summary(files)
    assert refused.exit_code == 2
    said(refused, "the first pose of the estimate's component")


def test_loops_are_all_pairs_but_consecutive_ones_and_uncertainty_is_relative_to_the_first_pose(files: Path) -> None:
    scores = evaluated(files, "--summary", str(files / "summary.json"))
    assert scores["pairs"]["sequential"]["kept_right"] == COUNT - 1
    loops, names = scores["pairs"]["loops"], ("kept_right", "kept_wrong", "rejected_right", "rejected_wrong")
    assert [loops[name] for name in (*names, "failed", "unjudged")] == [1, 1, 1, 0, 1, 0]
    uncertainty = scores["uncertainty"]
    assert (uncertainty["anchor"], uncertainty["poses"], uncertainty["within_95"]) == ("first", COUNT - 1, 1.0)
    (files / "summary.json").write_text(json.dumps(summary(covariances=False)))
    without = with_summary(files)
    assert without.exit_code == 0
    said(without, "has no covariances of the poses")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--map", "map.ply"], "--map needs --surface"),
        (["--map", "map.ply", "--surface", "truth.ply"], "give --voxel, or the map's --summary"),
        (["--summary", "truth.ply"], "expected the summary.json"),
    ],
)
def test_inconsistent_options_are_refused(files: Path, options: list[str], words: str) -> None:
    arguments = [str(files / word) if "." in word else word for word in options]
    result = sonarmap("evaluate", files / "estimate.tum", files / "truth.tum", *arguments)
    refused_with_reason(result)
    said(result, words)


def test_a_summary_without_its_table_is_refused(files: Path) -> None:
    (files / "pairs.csv").unlink()
    with pytest.raises(InputError, match=r"summary.json needs the pairs.csv of its map beside it"):
        read_summary(files / "summary.json")


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"settings": {}}, "settings.grid"),
        ({"scans": [{"stamp": "nan"}]}, "scans.0.stamp: Input should be a finite number"),
        ({"scans": [{"stamp": 0.0, "covariance": [[1.0]]}]}, "reshape"),
        ({"pairs": {"tried": 8}}, r"summary.json counts 8 pairs, and .*pairs.csv has 9; give both"),
        ({"pairs": [{"target": 0, "source": 1}]}, "earlier version.* map again"),
    ],
)
def test_an_invalid_summary_is_refused(files: Path, change: dict, named: str) -> None:
    (files / "summary.json").write_text(json.dumps(summary(covariances=False) | change))
    with pytest.raises(InputError, match=named):
        read_summary(files / "summary.json")


SOUND = "0,1,loop,yes,told,1,2,3,4,5,6"


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([], "holds no line but comments"),
        ([HEADING, SOUND.replace("0,1", "0,6")], "line 2: source is '6'"),
        ([HEADING, SOUND.replace("2,3", "nan,3")], "line 2: y_m is 'nan'"),
    ],
)
def test_an_invalid_table_of_pairs_is_refused(files: Path, rows: list[str], words: str) -> None:
    write_pairs(files, *rows)
    result = with_summary(files)
    refused_with_reason(result)
    said(result, "error: ", str(files / "pairs.csv"), words)


def test_a_table_that_a_spreadsheet_saved_is_read(files: Path) -> None:
    """With semicolons, decimal commas, a byte-order mark and line breaks of another system."""
    before = read_summary(files / "summary.json").pairs
    text = (files / "pairs.csv").read_text().replace(",", ";").replace(".", ",").replace("\n", "\r\n")
    (files / "pairs.csv").write_bytes(text.encode("utf-8-sig"))
    for ours, theirs in zip(before, read_summary(files / "summary.json").pairs, strict=True):
        assert (ours.target, ours.role, ours.kept) == (theirs.target, theirs.role, theirs.kept)
        assert (ours.T_target_source is None) == (theirs.T_target_source is None)
        if ours.T_target_source is not None and theirs.T_target_source is not None:
            assert (ours.T_target_source.as_matrix() == theirs.T_target_source.as_matrix()).all()


def test_everything_is_printed_with_its_alignment(files: Path) -> None:
    options = ("--map", files / "map.ply", "--surface", files / "truth.ply", "--summary", files / "summary.json")
    printed = sonarmap("evaluate", files / "estimate.tum", files / "truth.tum", *options).stdout
    for words in (
        ": 500 points compared with the 500 points of truth.ply, aligned like the trajectory by all poses.",
        "pairs, right within 6° and 1.50 m",
        "Uncertainty of 5 poses, relative to the first pose: 100.0 % of the true poses",
    ):
        assert words in printed


@pytest.mark.slow
def test_without_the_options_their_keys_are_null(files: Path) -> None:
    scores = evaluated(files)
    assert [scores[name] for name in ("map", "pairs", "uncertainty")] == [None, None, None]
