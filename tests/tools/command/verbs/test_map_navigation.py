"""`sonarmap map` with fixes now and then and dead reckoning: wrong fixes are named, and nothing is lost."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.poses.tum import read_tum
from tests.samples.clutter_scans import said, sonarmap

SCANS, WRONG = 10, "scan_006.ply"


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A survey with a position at every second scan, of which one is 30 m off, and odometry."""
    folder = tmp_path_factory.mktemp("dive")
    words = f"simulate --scene harbor --scans {SCANS} --priors position,depth --fix-every 2 --odometry 1,10 --seed 3"
    assert sonarmap(*words.split(), "-o", str(folder), "--quiet").exit_code == 0
    rows = list(csv.DictReader((folder / "priors.csv").open()))
    for row in rows:
        if row["name"] == WRONG:
            row["x_m"] = str(float(row["x_m"]) + 30.0)
    with (folder / "priors.csv").open("w") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return folder


@pytest.fixture(scope="module")
def mapped(dive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("mapped")
    result = sonarmap(
        *("map", str(dive), "-o", str(out), "--grid", "64", "--loops", "1"),
        *("--priors", str(dive / "priors.csv"), "--odometry", str(dive / "odometry.tum")),
    )
    assert result.exit_code == 0, result.stderr
    said(result, "the position of scan_006 is")
    return out


@pytest.mark.slow
def test_the_wrong_fix_is_named_and_left_out(mapped: Path, dive: Path) -> None:
    summary = json.loads((mapped / "summary.json").read_text())
    assert [(fix["name"], fix["kind"]) for fix in summary["wrong_fixes"]] == [("scan_006", "position")]
    estimate, truth = read_tum(mapped / "trajectory.tum"), read_tum(dive / "truth.tum")
    assert len(estimate) == SCANS
    away = estimate.T_world_sensor.translation - truth.T_world_sensor.translation
    assert np.linalg.norm(away, axis=1).max() < 6  # fixes of 3 m


def test_the_graph_gives_the_maps_poses(mapped: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.g2o"
    result = sonarmap("optimize", str(mapped / "graph.g2o"), "-o", str(again), "--json")
    assert result.exit_code == 0, result.stderr

    def poses(path: Path) -> np.ndarray:
        lines = [line.split() for line in path.read_text().splitlines() if line.startswith("VERTEX")]
        return np.array([[float(cell) for cell in line[2:5]] for line in lines])

    np.testing.assert_allclose(poses(again), poses(mapped / "graph.g2o"), atol=1e-6)


def test_options_without_effect_are_refused(dive: Path, tmp_path: Path) -> None:
    result = sonarmap("map", str(dive), "-o", str(tmp_path / "out"), "--odometry-drift", "1,10")
    assert result.exit_code == 2
    said(result, "--odometry-drift has no effect without --odometry")
    result = sonarmap("simulate", "-o", str(tmp_path / "sim"), "--fix-every", "3")
    assert result.exit_code == 2
    said(result, "no effect without --priors position")


def test_how_sure_positions_are_is_chosen_and_checked(tmp_path: Path) -> None:
    words = "simulate --scene harbor --scans 2 --priors position --seed 3"
    for sigma, folder in (("1", "sure"), ("3", "usual")):
        result = sonarmap(*words.split(), "--fix-sigma", sigma, "-o", str(tmp_path / folder))
        assert result.exit_code == 0, result.output
    truth = read_tum(tmp_path / "sure" / "truth.tum").T_world_sensor[1].translation
    sure, usual = (list(csv.DictReader((tmp_path / folder / "priors.csv").open()))[1] for folder in ("sure", "usual"))
    assert [float(row["x_sigma_m"]) for row in (sure, usual)] == [1.0, 3.0]
    # the same draw, a third as far off
    off = [np.array([float(row["x_m"]), float(row["y_m"])]) - truth[:2] for row in (sure, usual)]
    np.testing.assert_allclose(3 * off[0], off[1], atol=1e-5)
    result = sonarmap(*words.split(), "--fix-sigma", "0", "-o", str(tmp_path / "none"))
    assert result.exit_code == 2
    said(result, "--fix-sigma 0", "wanted meters above 0")
