"""Table 1: what its rows come to, beside the paper's, and that they are the same from every run."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from typer.testing import CliRunner

from sonarmap.kernels.device.device import Device
from sonarmap.slam.execute.journal import Journal
from sonarmap.spectral.result import Registration
from sonarmap.tools.command.main import app
from sonarmap.tools.lab.reproduce.answer import parameters
from sonarmap.tools.lab.reproduce.experiment import Row, Value
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.gaussian.run import create
from sonarmap.tools.lab.reproduce.gaussian.series import (
    VARIANTS,
    about_center,
    row_of,
)
from sonarmap.tools.lab.reproduce.provenance import provenance
from sonarmap.tools.lab.reproduce.rows import last_right
from sonarmap.tools.lab.reproduce.run import JOURNAL
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_COUNT, table1_transform
from sonarmap.tools.lab.simulate.plan import table1_pair

GRID = 128
TRUTH = RigidTransform.from_components([20, -7, 3], Rotation.from_euler("ZYX", [170, 4, -9], degrees=True))
CENTER = np.array([40.0, 15.0, -12.0])


def scored(yaw: float = 0, pitch: float = 0, shift: float = 0, roll: float = 0, **pair: Value) -> Row:
    """One that is off by so many degrees, turned about the scan's center, and by meters in x."""
    angles = TRUTH.rotation.as_euler("ZYX", degrees=True) + np.array([yaw, pitch, roll])
    R = Rotation.from_euler("ZYX", angles, degrees=True)
    translation = TRUTH.apply(CENTER) - R.apply(CENTER) + np.array([shift, 0, 0])
    steps = (("yaw", 9.0), ("tilt", 8.0), ("translation", 50.0), ("rival", 7.0))
    found = RigidTransform.from_components(translation, R)
    registration = Registration(found, np.eye(6), 50.0, 0.5, True, 0.25, step_psr=steps)
    usual: dict[str, Value] = {"scene": "floodgate", "grid": GRID, "voxel_m": 2.0, "sigma2": 1.0, "seed": 4, "scan": 0}
    return row_of(registration, TRUTH, CENTER, usual | {"method": "paper", "yaw_rank": 0} | pair)


class TestRow:
    @pytest.mark.parametrize(
        ("off", "step"),
        [
            ({}, ""),
            ({"shift": 5.99}, ""),
            ({"shift": 6.01}, "translation"),
            ({"shift": 2.9, "voxel_m": 1.0}, ""),
            ({"shift": 3.1, "voxel_m": 1.0}, "translation"),
            ({"yaw": 6.1}, "yaw"),
            ({"yaw": 12, "pitch": 20}, "yaw"),
            ({"yaw": 359}, ""),
            ({"pitch": -20}, "tilt"),
        ],
    )
    def test_the_bounds_and_the_first_wrong_step(self, off: dict[str, float], step: str) -> None:
        row = scored(**off)  # pyright: ignore[reportArgumentType]
        assert (row["right"], row["wrong_step"]) == (not step, step)

    def test_the_sensor_decides_and_the_center_is_told(self) -> None:
        """Turned about the scan's center by 5.9 degrees, the sensor is off by what 43 m of lever make of it."""
        turned, lever = scored(yaw=5.9, voxel_m=1.0), np.linalg.norm(CENTER[:2])
        assert turned["center_m"] == pytest.approx(0, abs=1e-12)
        assert turned["translation_m"] == pytest.approx(2 * lever * np.sin(np.deg2rad(5.9 / 2)), rel=0.05)
        assert (turned["right"], turned["right_at_center"]) == (False, True)

    def test_about_the_grids_center_they_are_the_papers_rows(self) -> None:
        """Row 8 of Table 1, as printed: x y z 36 72 108, yaw roll pitch 54 18 9."""
        truth = table1_pair(8, seed=0, sigma2=1.0)[2]
        assert parameters(about_center(truth)) == pytest.approx([36, 72, 108, 54, 18, 9], abs=1e-9)
        assert np.allclose(about_center(truth).as_matrix(), table1_transform(8).as_matrix())


def test_the_last_scan_ends_at_the_first_failure() -> None:
    wrong = {4: (7, 9), 5: (), 6: (0, 5)}
    rows: list[Row] = [
        {"seed": seed, "scan": scan, "right": scan not in wrong[seed]} for seed in wrong for scan in range(TABLE1_COUNT)
    ]
    assert last_right(rows, "scan", "seed") == last_right(rows[::-1], "scan", "seed") == [6, 9, -1]


class TestCommand:
    @pytest.mark.parametrize("scene", ["pool"])
    def test_scenes_that_the_papers_steps_do_not_fit_are_refused(self, scene: str, tmp_path: Path) -> None:
        result = CliRunner().invoke(app, ["reproduce", "gaussian", "--scene", scene, "-o", str(tmp_path / "out")])
        assert (result.exit_code, (tmp_path / "out").exists()) == (2, False)

    @pytest.mark.slow
    def test_two_runs_with_one_seed_give_the_same_rows(self, tmp_path: Path, device: Device) -> None:
        """Once by the command line, and two jobs again in another order by an experiment of its own."""
        arguments = ["reproduce", "gaussian", "--quick", "--grid", "32", "--seed", "2", "-o", str(tmp_path), "--json"]
        shown = CliRunner().invoke(app, [*arguments, "--device", device.selector])
        assert (shown.exit_code, shown.stderr) == (0, "")
        with (tmp_path / "gaussian.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        scans = [(str(index), method) for index in range(TABLE1_COUNT) for method in VARIANTS]
        assert [(row["scan"], row["method"]) for row in rows] == scans
        record = json.loads(shown.stdout)["experiments"][0]
        assert record["command"] == "sonarmap reproduce gaussian --quick --grid 32 --seed 2"
        assert len((tmp_path / "gaussian-seconds.csv").read_text().splitlines()) == 1 + len(rows)
        again = create(Request(device, quick=True, grid=32, seed=2))
        origin = provenance(again, device)
        with Journal(tmp_path / JOURNAL) as journal:
            kept = {job: entry for job in again.jobs() if (entry := journal.entry(origin.key(job)))}
        assert list(kept) == list(again.jobs())
        for job in ("32/1.0/2/S4", "32/1.0/2/S1"):
            assert list(again.run(job).rows) == json.loads(kept[job].content)["rows"]
