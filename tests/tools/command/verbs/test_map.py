"""`sonarmap map` end to end: the files that it writes, and earlier files in its folder."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.scans import read_scan
from sonarmap.tools.files.readers.trajectory import read_tum
from sonarmap.tools.files.writers.poses import write_tum
from sonarmap.tools.lab.evaluate.trajectory import evaluate
from tests.samples.clutter_scans import (
    T_WORLD_SENSOR,
    clutter,
    done,
    files_in,
    printed,
    refused,
    said,
    scan,
    sonarmap,
    strict_json,
    table_of,
    write,
)

GRID = ("--grid", "64")
RESULTS = {"map.ply", "map_all.ply", "map.png", "trajectory.tum", "graph.g2o", "graph.json"}
RESULTS |= {"pairs.csv", "summary.json", "times.json", "report.html", "journal.sqlite"}


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four scans, and their map in out/."""
    folder = tmp_path_factory.mktemp("survey")
    write(folder, **{f"scan_{k}": scan(k) for k in range(4)})
    result = sonarmap("map", folder, "-o", folder / "out", *GRID, "--json")
    assert (result.exit_code, result.stderr) == (0, "")
    (folder / "printed.json").write_text(result.stdout)
    return folder


def test_exactly_the_result_files_are_written(survey: Path) -> None:
    assert set(files_in(survey / "out")) == RESULTS
    assert (survey / "out" / "map.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


def test_trajectory_map_and_pairs_match_the_truth(survey: Path, tmp_path: Path) -> None:
    truth, out = Trajectory(np.arange(4.0), T_WORLD_SENSOR), survey / "out"
    result = evaluate(read_tum(out / "trajectory.tum"), truth, "first")
    assert result.translation_m.max() < 0.3
    assert result.rotation_deg.max() < 1.5
    write_tum(tmp_path / "truth.tum", truth)
    (surface,) = write(tmp_path, clutter=clutter())
    pair = (out / "trajectory.tum", tmp_path / "truth.tum")
    plain = sonarmap("evaluate", *pair, "--json")
    assert (bool(printed(plain)), plain.stderr) == (True, "")
    options = ("--map", out / "map.ply", "--surface", surface, "--summary", out / "summary.json", "--json")
    evaluation = printed(sonarmap("evaluate", *pair, *options))
    assert evaluation["pairs"]["sequential"]["kept_right"] == 3
    assert evaluation["pairs"]["sequential"]["kept_wrong"] + evaluation["pairs"]["loops"]["kept_wrong"] == 0
    assert evaluation["map"]["median_m"] < 0.3
    assert evaluation["map"]["within_voxel"] > 0.9


def test_the_summary_is_strict_json_and_equals_the_printed_json(survey: Path) -> None:
    summary = strict_json((survey / "out" / "summary.json").read_text())
    assert strict_json((survey / "printed.json").read_text()) == summary
    assert summary["versions"]["numpy"] == np.__version__
    assert summary["settings"]["grid"]["edge"] == 64
    assert "priors" not in summary["settings"]
    assert summary["device"]["name"]
    assert [scan["name"] for scan in summary["scans"]] == [f"scan_{k}" for k in range(4)]
    assert summary["pairs"]["by_role"]["sequential"] == {"tried": 3, "kept": 3}
    assert summary["gaps"] == []


def test_the_same_command_gives_the_same_bytes(survey: Path, tmp_path: Path) -> None:
    scans = [survey / f"scan_{k}.ply" for k in range(4)]
    assert sonarmap("map", *scans, "-o", tmp_path, *GRID, "--quiet").exit_code == 0
    first, second = files_in(survey / "out"), files_in(tmp_path)
    # summary and report differ only in the inputs: the folder or its files
    varying = {"summary.json", "report.html", "times.json", "journal.sqlite"}
    assert {name for name in RESULTS if first[name] != second[name]} == varying
    one, other = (json.loads(files["summary.json"]) for files in (first, second))
    assert one["settings"].pop("inputs") == [str(survey)]
    assert other["settings"].pop("inputs") == [str(path) for path in scans]
    assert one == other


def test_times_are_in_times_json(survey: Path) -> None:
    times = strict_json((survey / "out" / "times.json").read_text())
    pairs = {(int(pair["target"]), int(pair["source"])) for pair in table_of(survey / "out" / "pairs.csv")}
    assert {(pair["target"], pair["source"]) for pair in times["pairs"]} == pairs
    assert all(pair["seconds"] > 0 and not pair["from_journal"] for pair in times["pairs"])
    assert (times["workers"], times["pairs_from_journal"]) == (1, 0)
    assert times["stages_s"].keys() >= {"pairs registered", "poses optimized", "map fused"}
    assert times["peak_memory_bytes"] > 2**20


@pytest.mark.slow
def test_any_file_name_is_accepted(tmp_path: Path) -> None:
    write(tmp_path, **{"1 a\nb\x1b[2J": scan(0), "2 [x] $é$ 深 \udcff": scan(1)})
    result = done(sonarmap("map", tmp_path, "-o", tmp_path / "out [1] $ü", *GRID))
    assert "\x1b" not in result.stdout + result.stderr
    assert set(files_in(tmp_path / "out [1] $ü")) == RESULTS
    assert len(strict_json((tmp_path / "out [1] $ü" / "summary.json").read_text())["scans"]) == 2


@pytest.mark.slow
def test_min_seen_1_puts_all_points_into_the_map(survey: Path, tmp_path: Path) -> None:
    """Pairs come from the earlier run's journal; the points of its map_all.ply are all in map.ply."""
    shutil.copytree(survey / "out", tmp_path / "out")
    everything = read_scan(tmp_path / "out" / "map_all.ply").points
    summary = printed(sonarmap("map", survey, "-o", tmp_path / "out", *GRID, "--set", "min_seen=1", "--json"))
    assert summary["settings"]["mapper"]["min_seen"] == 1
    assert summary["components"][0]["map"]["seen_by_too_few"] == 0
    assert set(files_in(tmp_path / "out")) == RESULTS - {"map_all.ply"}
    whole = read_scan(tmp_path / "out" / "map.ply").points
    np.testing.assert_array_equal(whole[np.lexsort(whole.T)], everything[np.lexsort(everything.T)])
    refused(sonarmap("map", survey, "-o", tmp_path / "out", *GRID, "--set", "min_seen=0"), "min_seen=0")


@pytest.mark.slow
def test_an_earlier_map_is_not_used_as_a_scan(tmp_path: Path) -> None:
    paths = write(tmp_path, a=scan(0), b=scan(1))
    assert sonarmap("map", tmp_path, "-o", tmp_path, *GRID).exit_code == 0
    before = files_in(tmp_path)
    for inputs in ([tmp_path], paths):
        again = sonarmap("map", *inputs, "-o", tmp_path, *GRID, "--json")
        assert [row["name"] for row in json.loads(again.stdout)["scans"]] == ["a", "b"]
        said(again, "whose files are no scans: left out map.ply")
        assert set(files_in(tmp_path)) == set(before)


@pytest.mark.slow
def test_scans_of_two_places_give_two_maps_with_their_exports(tmp_path: Path) -> None:
    paths, out = write(tmp_path, a=scan(0), b=scan(1), c=scan(2, scene=2), d=scan(3, scene=2)), tmp_path / "out"
    result = sonarmap("map", *paths, "-o", out, *GRID, "--export", "mcap,g2o")
    assert result.exit_code == 3
    names = ["map.mcap", "map_2.mcap", "graph.csv"]
    second = ["map_2.ply", "map_all_2.ply", "map_2.png", "trajectory_2.tum"]
    assert set(files_in(out)) == RESULTS | {*names, *(f"{name}.json" for name in names), *second}
    tried = [(int(row["target"]), int(row["source"])) for row in table_of(out / "pairs.csv") if row["kept"] == "yes"]
    assert not any(i < 2 <= j for i, j in tried)
    summary = strict_json((out / "summary.json").read_text())
    assert [part["scans"] for part in summary["components"]] == [[0, 1], [2, 3]]
    assert summary["gaps"] == [[1, 2]]
    assert "4 of 4 placed in 2 separate maps" in result.stdout
    said(result, "gap between b and c: refused by the registration", "2 separate parts")
