"""`sonarmap map` of several surveys, and with `--ties` and `--control`: nothing is registered twice."""

import json
from pathlib import Path

import numpy as np
import pytest

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.scans import read_scan
from sonarmap.tools.files.readers.trajectory import read_tum
from sonarmap.tools.lab.evaluate.trajectory import evaluate
from tests.samples.clutter_scans import T_WORLD_SENSOR, done, files_in, scan, sonarmap, table_of, write

GRID = ("--grid", "64", "--no-report")
SCANS = 8
# scan -> point picked in it [m, sensor frame]; the truth gives its world coordinates
PICKED = {0: (6.0, 3.0, -2.0), 2: (5.0, -4.0, 1.0), 5: (7.0, 2.0, -3.0), 7: (4.0, 5.0, 0.5), 4: (3.0, -2.0, -1.0)}


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dive")
    words = f"simulate --scene harbor --scans {SCANS} --seed 3"
    assert sonarmap(*words.split(), "-o", folder, "--quiet").exit_code == 0
    return folder


@pytest.fixture(scope="module")
def out(dive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map without manual constraints; the tests continue from its journal."""
    folder = tmp_path_factory.mktemp("map")
    assert sonarmap("map", dive, "-o", folder, *GRID).exit_code == 0
    return folder


def registered(out: Path) -> tuple[int, int]:
    """Numbers of pairs of the last run, and of those not from the journal."""
    times = json.loads((out / "times.json").read_text())
    return len(times["pairs"]), len(times["pairs"]) - times["pairs_from_journal"]


@pytest.mark.slow
def test_manual_verdicts_register_no_pair_again(dive: Path, out: Path, tmp_path: Path) -> None:
    before = table_of(out / "pairs.csv")
    loop = next(row for row in before if row["role"] == "loop")
    pair = f"{loop['target']},{loop['source']}"
    ties = tmp_path / "ties.csv"
    count = registered(out)[0]
    for verdict, kept in (("reject", "no"), ("accept", "yes"), ("add", "yes")):
        ties.write_text(f"# by hand\ntarget,source,verdict,note\n{pair},{verdict},because\n")
        done(sonarmap("map", dive, "-o", out, *GRID, "--ties", ties))
        assert registered(out) == (count, 0)
        rows = table_of(out / "pairs.csv")
        assert [row["target"] + row["source"] for row in rows] == [row["target"] + row["source"] for row in before]
        row = next(row for row in rows if f"{row['target']},{row['source']}" == pair)
        assert row["kept"] == kept
        assert "by hand" in row["reason"]
        (tie,) = json.loads((out / "summary.json").read_text())["ties"]
        assert set(tie) == {"target", "source", "verdict", "note", "effect"}
        assert (tie["verdict"], tie["note"]) == (verdict, "because")
        assert tie["target"] == f"scan_{int(loop['target']):03}"


def control_file(folder: Path, dive: Path, off: float = 0.0, check: int = 4) -> Path:
    """Points with errors of 5 cm; that of scan `check` is a check point, that of scan 5 is `off` by a blunder [m]."""
    truth, rng = read_tum(dive / "truth.tum").T_world_sensor, np.random.default_rng(3)
    rows = ["name,scan,x_m,y_m,z_m,east_m,north_m,up_m,sigma_m,use"]
    for k, picked in PICKED.items():
        known = truth[k].apply(picked) + 0.05 * rng.normal(size=3) + (k == 5) * np.array([off, 0, 0])
        numbers = ",".join(f"{value:.4f}" for value in (*picked, *known))
        rows.append(f"P{k},scan_{k:03},{numbers},0.05,{'check' if k == check else 'control'}")
    path = folder / "control.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.slow
def test_control_points_place_the_map_in_the_world(dive: Path, out: Path, tmp_path: Path) -> None:
    control = control_file(tmp_path, dive)
    world = ("--control", control, "--origin", "60.3913,5.3221", "--export", "laz")
    result = done(sonarmap("map", dive, "-o", out, *GRID, *world))
    assert registered(out)[1] == 0
    estimate, truth = (read_tum(path).T_world_sensor for path in (out / "trajectory.tum", dive / "truth.tum"))
    assert np.linalg.norm(estimate.translation - truth.translation, axis=1).max() < 1.0
    summary = json.loads((out / "summary.json").read_text())
    rows = {row["name"]: row for row in summary["control_points"]}
    assert list(rows) == [f"P{k}" for k in PICKED]
    assert rows["P4"]["use"] == "check"
    for row in rows.values():
        np.testing.assert_allclose(np.subtract(row["estimated"], row["known"]), row["residual"], atol=1e-9)
        assert row["in_sigmas"] == pytest.approx(np.linalg.norm(row["residual"]) / 0.05)
        assert np.linalg.norm(row["residual"]) < 0.6
    assert summary["control"]["control"]["points"] == 4
    assert summary["control"]["check"]["rms_m"] == pytest.approx(np.linalg.norm(rows["P4"]["residual"]))
    assert summary["components"][0]["unmeasured"] == []
    assert "control points, which the map is fitted to: 4, residuals" in result.stdout
    assert json.loads((out / "map.laz.json").read_text())["crs"]["epsg"] == 32632


@pytest.mark.slow
def test_two_folders_are_two_surveys_of_one_map(tmp_path: Path) -> None:
    """Only its scans relate the second survey to the first; each survey has its own layer."""
    for name, members in (("a", (0, 1)), ("b", (2, 3))):
        (tmp_path / name).mkdir()
        write(tmp_path / name, **{f"scan_{k}": scan(k) for k in members})
    out = tmp_path / "out"
    result = sonarmap("map", tmp_path / "a", tmp_path / "b", "-o", out, "--grid", "64", "--json")
    assert (result.exit_code, result.stderr) == (0, "")
    summary = json.loads(result.stdout)
    assert [row["survey"] for row in summary["scans"]] == [0, 0, 1, 1]
    tried = table_of(out / "pairs.csv")
    chained = [(pair["target"], pair["source"]) for pair in tried if pair["role"] == "sequential"]
    assert chained == [("0", "1"), ("2", "3")]
    assert any(pair["kept"] == "yes" and pair["alike"] for pair in tried)
    assert [part["scans"] for part in summary["components"]] == [[0, 1, 2, 3]]
    found = evaluate(read_tum(out / "trajectory.tum"), Trajectory(np.arange(4.0), T_WORLD_SENSOR), "first")
    assert found.translation_m.max() < 0.3
    layers = [read_scan(out / f"map_survey_{number}.ply").points for number in (0, 1)]
    assert len(files_in(out)) == 15
    assert all(len(layer) for layer in layers)
    wholes = [read_scan(out / f"map_all_survey_{number}.ply").points for number in (0, 1)]
    doubtful = [row["seen_by_too_few"] for row in summary["components"][0]["surveys"].values()]
    assert [len(whole) - len(layer) for whole, layer in zip(wholes, layers, strict=True)] == doubtful
    assert max(map(len, layers)) < len(read_scan(out / "map.ply").points) < sum(map(len, layers))
