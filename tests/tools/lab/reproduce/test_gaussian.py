"""Table 1: what its rows come to, beside the paper's, and that they are the same from every run."""

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from typer.testing import CliRunner

from sonarmap.kernels.device.device import Device
from sonarmap.slam.execute.journal import Journal
from sonarmap.spectral.hemisphere.layers import AngleEstimate
from sonarmap.spectral.hemisphere.registration import HemisphereConfig, HemisphereRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.tools.command.main import app
from sonarmap.tools.lab.reproduce.answer import PARAMETERS, parameters
from sonarmap.tools.lab.reproduce.experiment import Row, Value
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.folder import section_text, verdicts
from sonarmap.tools.lab.reproduce.gaussian.run import Gaussian, GaussianSettings, create
from sonarmap.tools.lab.reproduce.gaussian.section import (
    detail_table,
    verdict_table,
)
from sonarmap.tools.lab.reproduce.gaussian.series import (
    VARIANTS,
    Series,
    about_center,
    preparation_of,
    row_of,
    yaw_rank,
)
from sonarmap.tools.lab.reproduce.provenance import provenance
from sonarmap.tools.lab.reproduce.rows import last_right, where
from sonarmap.tools.lab.reproduce.run import JOURNAL
from sonarmap.tools.lab.reproduce.settings import paper_grid
from sonarmap.tools.lab.reproduce.table import Table
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_COUNT, table1_transform
from sonarmap.tools.lab.simulate.plan import table1_pair
from tests.samples.experiments.shown import show

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


def rows_of(wrong: Mapping[int, Sequence[int]], sigma2: float = 1.0, grid: int = GRID) -> list[Row]:
    """All methods alike; `wrong` says per seed, from 4 on, which scans fail, in their translation."""
    return [
        scored(shift=99.0 if scan in wrong[k] else 0.5, sigma2=sigma2, seed=4 + k, scan=scan, method=method, grid=grid)
        for k in wrong
        for scan in range(TABLE1_COUNT)
        for method in VARIANTS
    ]


def changed(rows: list[Row], which: Callable[[Row], bool], **changes: Value) -> list[Row]:
    return [{**row, **changes} if which(row) else row for row in rows]


def cells(table: Table, *headings: str) -> list[tuple[str, ...]]:
    """Of every line the cells of these columns."""
    return [tuple(line[table.headings.index(heading)] for heading in headings) for line in table.rows]


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


class TestSummary:
    def test_the_last_scan_ends_at_the_first_failure(self) -> None:
        rows = where(rows_of({0: [7, 9], 1: [], 2: [0, 5]}), method="paper")
        assert last_right(rows, "scan", "seed") == last_right(rows[::-1], "scan", "seed") == [6, 9, -1]

    @pytest.mark.parametrize(
        ("sigma2", "wrong", "verdict", "middle"),
        [
            (1.0, {0: [9], 1: []}, "reached", 8),
            (1.0, {0: [8], 1: [9]}, "reached by 1 of 2 seeds", 7),
            (2.0, {0: [7], 1: [8], 2: [8]}, "reached", 7),
            (2.0, {0: [6], 1: [2]}, "not reached", 1),
            (3.0, {0: [], 1: []}, "", 9),
        ],
    )
    def test_the_verdict_beside_the_papers(
        self, sigma2: float, wrong: dict[int, list[int]], verdict: str, middle: int
    ) -> None:
        lines = cells(verdict_table(rows_of(wrong, sigma2)), "method", "verdict", "ours, median (each seed)")
        assert [(*line[:2], line[2].split()[0]) for line in lines] == [(m, verdict, f"S{middle}") for m in VARIANTS]

    def test_grids_and_noises_are_apart(self) -> None:
        rows = [*rows_of({0: [3]}), *rows_of({0: [5]}, grid=256), *rows_of({0: [7]}, 2.0)]
        last = cells(verdict_table(rows), "grid", "σ²", "ours, median (each seed)")
        first, second, third = ("128³", "σ² = 1 m²"), ("256³", "σ² = 1 m²"), ("128³", "σ² = 2 m²")
        assert list(dict.fromkeys(last)) == [(*first, "S2 (S2)"), (*second, "S4 (S4)"), (*third, "S6 (S6)")]

    def test_what_was_believed_wrongly_is_counted(self) -> None:
        rows = changed(rows_of({0: [8, 9]}), lambda row: row["scan"] in (0, 9), accepted=False)
        for line in cells(verdict_table(rows), "right", "accepted though wrong", "refused though right"):
            assert (line[0].split()[0], *line[1:]) == ("8/10", "1", "1")
        assert all(error.endswith(", 0.50 m") for (error,) in cells(detail_table(rows), "median error where right"))

    def test_every_failure_counts_and_the_first_of_a_seed_ends_it(self) -> None:
        rows = rows_of({0: [2, 5, 8], 1: [4]})
        rows = changed(rows, lambda row: row["scan"] == 2 and not row["right"], wrong_step="yaw")
        headings = ("first wrong: yaw / tilt / translation", "series ended by each of these")
        assert cells(detail_table(rows), *headings) == [("1 / 0 / 3", "1 / 0 / 1")] * len(VARIANTS)


class TestWords:
    @pytest.mark.slow
    def test_the_section_states_its_verdicts_and_draws_the_same_again(self, device: Device, tmp_path: Path) -> None:
        rows = [*rows_of({0: [8], 1: [9]}), *rows_of({0: [], 1: []}, grid=256)]
        times = [
            {"grid": GRID, "method": "paper", "prepare_s": a, "register_s": b} for a, b in ((0.25, 1.0), (0.5, 9.0))
        ]
        experiment = Gaussian(GaussianSettings(first_seed=4), device)
        shown, again = (show(experiment, tmp_path / name, rows, times) for name in "ab")
        text = section_text(shown)
        line = "| 128³ | σ² = 1 m² | paper | S8 | S7 (S7 S8) | reached by 1 of 2 seeds | 18/20 [0.70..0.97] | 2 |"
        assert line in text
        assert [verdict.verdict for verdict in verdicts(shown)] == ["reached by 1 of 2 seeds"] * 3 + ["reached"] * 3
        assert set(again.pictures) == {"gaussian-128.png", "gaussian-256.png", "gaussian-rates.png"}
        assert shown.times[0].rows == (("128³", "paper", "10.5 s", "5.75 s", "0.38 s", "5.00 s"),)
        for name in shown.pictures:
            first, second = ((tmp_path / folder / name).read_bytes() for folder in "ab")
            assert first == second
            assert len(first) < 300_000


def test_the_place_of_the_right_pair_of_peaks() -> None:
    """A peak stands for its angle and for the one turned about; S3's true yaw is 24 degrees."""
    truth = table1_pair(3, 1, 1.0)[2]
    for yaws, rank in (([90, 17], 0), ([90, 19, 29], 2), ([24, 25], 1), ([0, 90, 150, 204], 4), ([], 0)):
        turned = [yaw + turn for yaw in yaws for turn in (0, 180)]
        peaks = [AngleEstimate(Rotation.from_euler("Z", yaw, degrees=True), 1.0) for yaw in turned]
        hemisphere = SimpleNamespace(yaw_candidates=lambda _target, _source, count, p=peaks: p[: 2 * count])
        scan = SimpleNamespace(layers=None)
        assert yaw_rank(SimpleNamespace(hemisphere=hemisphere), scan, scan, truth) == rank  # pyright: ignore


class TestSeries:
    def test_what_pairs_alone_need_is_prepared_once(self) -> None:
        one, six = (VARIANTS[name].config for name in ("one peak", "six peaks"))
        assert one != six
        assert preparation_of(one) == preparation_of(six) == HemisphereConfig()
        for config in (VARIANTS["paper"].config, HemisphereConfig(use_strength=True)):
            assert preparation_of(config) != HemisphereConfig()

    @pytest.mark.slow
    def test_shared_or_not_the_rows_are_the_same(self, device: Device) -> None:
        series = Series(device, paper_grid(32), "floodgate")
        by_method = {row["method"]: row for row, _ in series.register(2, 1, 1.0)}
        target, source, truth = table1_pair(2, 1, 1.0)
        for name, method in VARIANTS.items():
            alone = HemisphereRegistrar(device, paper_grid(32), method.config)
            registration = alone.register(alone.prepare(target), alone.prepare(source))
            for which, T in (("found", registration.T_target_source), ("true", truth)):
                listed = [by_method[name][f"{which}_{parameter}"] for parameter in PARAMETERS]
                assert listed == pytest.approx(parameters(about_center(T)), abs=1e-9)
            assert by_method[name]["psr"] == registration.psr

    @pytest.mark.slow
    def test_one_grid_is_planned_at_a_time(self, device: Device) -> None:
        experiment = Gaussian(GaussianSettings(seeds=1, edges=(16, 32), sigma2=(0.0,)), device)
        for job, edge in (("32/0.0/11/S0", 32), ("16/0.0/11/S0", 16), ("32/0.0/11/S1", 32)):
            assert [row["grid"] for row in experiment.run(job).rows] == [edge] * len(VARIANTS)


class TestCommand:
    @pytest.mark.parametrize("scene", ["pool", "moon"])
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
