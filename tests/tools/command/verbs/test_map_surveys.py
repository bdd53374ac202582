"""`sonarmap map` with the folders of several surveys: joined without a pair between consecutive ones, told apart."""

import json
from pathlib import Path

import numpy as np

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.mapper import Mapper
from sonarmap.tools.files.readers.poses.trajectory import read_tum
from sonarmap.tools.files.readers.scans import read_scan
from sonarmap.tools.lab.evaluate.trajectory import evaluate
from tests.samples.clutter_scans import T_WORLD_SENSOR, files_in, scan, sonarmap, table_of, write
from tests.samples.surveys import KnowingRegistrar, ring_poses, scans_of


def test_two_folders_are_two_surveys_of_one_map(tmp_path: Path) -> None:
    """Nothing says how the second lies to the first but what its scans look like; each has a layer of its own."""
    for name, members in (("a", (0, 1)), ("b", (2, 3))):
        (tmp_path / name).mkdir()
        write(tmp_path / name, **{f"scan_{k}": scan(k) for k in members})
    out = tmp_path / "out"
    result = sonarmap("map", tmp_path / "a", tmp_path / "b", "-o", out, "--grid", "64", "--json")
    assert (result.exit_code, result.stderr) == (0, "")
    summary = json.loads(result.stdout)
    assert [one["survey"] for one in summary["scans"]] == [0, 0, 1, 1]
    tried = table_of(out / "pairs.csv")
    chained = [(pair["target"], pair["source"]) for pair in tried if pair["role"] == "sequential"]
    assert chained == [("0", "1"), ("2", "3")]
    assert any(pair["kept"] == "yes" and pair["alike"] for pair in tried)
    assert [part["scans"] for part in summary["components"]] == [[0, 1, 2, 3]]
    found = evaluate(read_tum(out / "trajectory.tum"), Trajectory(np.arange(4.0), T_WORLD_SENSOR), "first")
    assert found.translation_m.max() < 0.3
    layers = [read_scan(out / f"map_survey_{number}.ply").points for number in (0, 1)]
    assert len(files_in(out)) == 17
    assert all(len(layer) for layer in layers)
    wholes = [read_scan(out / f"map_all_survey_{number}.ply").points for number in (0, 1)]
    doubtful = [row["seen_by_too_few"] for row in summary["components"][0]["surveys"].values()]
    assert [len(whole) - len(layer) for whole, layer in zip(wholes, layers, strict=True)] == doubtful
    assert max(map(len, layers)) < len(read_scan(out / "map.ply").points) < sum(map(len, layers))


def test_two_surveys_of_one_scan_each_have_no_pair_to_try() -> None:
    """One pair alone never joins two surveys, so that there is nothing to find out."""
    truth = ring_poses(2, turns=0.1)
    result = Mapper(KnowingRegistrar(truth, np.eye(6) * 1e-4), 0.5).run(scans_of(truth), surveys=[0, 1])
    assert result.components == ((0,), (1,))
    assert result.gaps == ()


def test_what_a_killed_run_had_half_written_goes(tmp_path: Path) -> None:
    write(tmp_path, **{f"scan_{k}": scan(k) for k in range(2)})
    out = tmp_path / "out"
    out.mkdir()
    (out / ".sonarmap.abc123.ply").write_bytes(b"ply\nhalf")
    (out / ".sonarmap").write_text("mine")
    assert sonarmap("map", tmp_path, "-o", out, "--grid", "64", "--quiet").exit_code == 0
    assert {name for name in files_in(out) if name.startswith(".")} == {".sonarmap"}
