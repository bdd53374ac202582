"""The paper's experiments: what counts as right, how it is counted, and the files that are left."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from scipy.spatial.transform import RigidTransform, Rotation
from typer.testing import CliRunner

from kernels.errors import InputError
from spectral.result import Registration
from tools.cli.main import app
from tools.reproduce.gaussian import GaussianResult, GaussianRow, GaussianSettings, about_center
from tools.reproduce.gaussian_figure import parameters
from tools.reproduce.gaussian_folder import COLUMNS, write_gaussian
from tools.reproduce.gaussian_page import gaussian_page
from tools.reproduce.gaussian_summary import last_right, summarize
from tools.reproduce.methods import METHODS
from tools.reproduce.table import Table, write_csv
from tools.reproduce.trial import Trial
from tools.reproduce.wilson import wilson
from tools.simulate.series import TABLE1_COUNT, table1_pair, table1_transform

TRUTH = RigidTransform.from_components([20, -7, 3], Rotation.from_euler("ZYX", [170, 4, -9], degrees=True))
CENTER = np.array([40.0, 15.0, -12.0])


def trial(yaw: float = 0, pitch: float = 0, shift: float = 0, voxel: float = 2.0) -> Trial:
    """One that is off by so many degrees of yaw and pitch, turned about the scan's center, and by meters in x."""
    angles = TRUTH.rotation.as_euler("ZYX", degrees=True) + np.array([yaw, pitch, 0])
    R = Rotation.from_euler("ZYX", angles, degrees=True)
    translation = TRUTH.apply(CENTER) - R.apply(CENTER) + np.array([shift, 0, 0])
    found = RigidTransform.from_components(translation, R)
    steps = (("yaw", 9.0), ("tilt", 8.0), ("translation", 50.0), ("rival", 7.0))
    return Trial(Registration(found, np.eye(6), 50.0, 0.5, True, 0.25, step_psr=steps), TRUTH, CENTER, voxel)


def result_of(wrong: dict[int, list[int]], sigma2: float = 1.0, seed: int = 4) -> GaussianResult:
    """All methods alike; `wrong` says per seed which scans fail."""
    settings = GaussianSettings(sigma2=(sigma2,), seeds=len(wrong), first_seed=seed)
    rows = [
        GaussianRow(sigma2, seed + k, index, method, trial(shift=99.0 if index in wrong[k] else 0.5))
        for k in wrong
        for index in range(TABLE1_COUNT)
        for method in METHODS
    ]
    return GaussianResult(settings, "a device", tuple(rows), 12.0)


class TestWilson:
    @pytest.mark.parametrize(
        ("successes", "trials", "low", "high"),
        [(0, 10, 0.0, 0.2775), (7, 10, 0.3968, 0.8922), (81, 263, 0.2553, 0.3662)],
    )
    def test_published_intervals(self, successes: int, trials: int, low: float, high: float) -> None:
        """81 of 263 is the example of Newcombe (Statistics in Medicine 17, 1998, method 3)."""
        rate = wilson(successes, trials)
        assert (rate.low, rate.high) == pytest.approx((low, high), abs=5e-5)

    def test_in_words(self) -> None:
        assert str(wilson(7, 10)) == "7/10 [0.40..0.89]"


class TestTrial:
    def test_the_bounds(self) -> None:
        assert trial().right
        assert trial(shift=5.99).right
        assert not trial(shift=6.01).right
        assert trial(shift=2.9, voxel=1.0).right
        assert not trial(shift=3.1, voxel=1.0).right
        assert not trial(yaw=6.1).right

    def test_the_sensor_decides_and_the_center_is_told(self) -> None:
        """Turned about the scan's center by 5.9 degrees, the sensor is off by what 43 m of lever make of it."""
        turned = trial(yaw=5.9, voxel=1.0)
        lever = np.linalg.norm(CENTER[:2])
        assert turned.center_m == pytest.approx(0, abs=1e-12)
        assert turned.error.translation_m == pytest.approx(2 * lever * np.sin(np.deg2rad(5.9 / 2)), rel=0.05)
        assert not turned.right
        assert turned.right_at_center

    @pytest.mark.parametrize(
        ("off", "step"),
        [
            ({}, ""),
            ({"yaw": 12}, "yaw"),
            ({"yaw": 12, "pitch": 20}, "yaw"),
            ({"yaw": 359}, ""),
            ({"pitch": -20}, "tilt"),
            ({"shift": 30}, "translation"),
        ],
    )
    def test_the_first_wrong_step(self, off: dict[str, float], step: str) -> None:
        assert trial(**off).wrong_step == step


class TestSummary:
    def test_the_last_scan_ends_at_the_first_failure(self) -> None:
        result = result_of({0: [7, 9], 1: [], 2: [0, 5]})
        assert last_right(result.of(1.0, "paper")) == (6, 9, -1)

    @pytest.mark.parametrize(
        ("sigma2", "wrong", "verdict"),
        [
            (1.0, {0: [9], 1: []}, "reached"),
            (1.0, {0: [8], 1: [9]}, "reached by 1 of 2 seeds"),
            (2.0, {0: [7], 1: [8]}, "reached"),
            (2.0, {0: [6], 1: [2]}, "not reached"),
            (3.0, {0: [], 1: []}, ""),
        ],
    )
    def test_the_verdict_beside_the_papers(self, sigma2: float, wrong: dict[int, list[int]], verdict: str) -> None:
        assert {summary.verdict for summary in summarize(result_of(wrong, sigma2))} == {verdict}

    def test_what_was_believed_wrongly_is_counted(self) -> None:
        result = result_of({0: [8, 9]})
        refused = {
            index: replace(row.trial, registration=replace(row.trial.registration, accepted=False))
            for index, row in enumerate(result.rows)
            if row.index in (0, 1, 9)
        }
        rows = tuple(replace(row, trial=refused.get(k, row.trial)) for k, row in enumerate(result.rows))
        for summary in summarize(replace(result, rows=rows)):
            assert (summary.accepted_wrong, summary.refused_right) == (1, 2)
            assert (summary.right.successes, summary.right.trials) == (8, 10)
            assert summary.wrong_steps == {"yaw": 0, "tilt": 0, "translation": 2}
            assert summary.translation_m == pytest.approx(0.5)


class TestTables:
    def test_markdown(self) -> None:
        table = Table("t", ("a", "b|c"), (("1", "2"), ("3", "4")))
        assert table.markdown() == "**t**\n\n| a | b\\|c |\n| --- | --- |\n| 1 | 2 |\n| 3 | 4 |\n"

    def test_brackets_are_no_markup(self) -> None:
        console = Console(width=80)
        with console.capture() as shown:
            console.print(Table("[bold]t", ("a",), (("[red]1",),)).rich())
        assert "[bold]t" in shown.get()
        assert "[red]1" in shown.get()

    def test_csv_cells(self, tmp_path: Path) -> None:
        write_csv(tmp_path / "a.csv", ("a", "b", "c", "d"), [(True, -1e-9, 3, "S0, S1")])
        assert (tmp_path / "a.csv").read_bytes() == b'a,b,c,d\n1,0.0000,3,"S0, S1"\n'

    def test_the_page_states_its_bounds_and_its_command(self) -> None:
        page = gaussian_page(result_of({0: [8], 1: [9]}, seed=4), "p.png", "r.csv")
        assert "within 6 degrees and 3 voxels of the grid used (6 m)" in page
        assert "| 1 | paper | S8 | S7 S8 | reached by 1 of 2 seeds | 18/20 [0.70..0.97] | 2 | 0 |" in page
        assert "(p.png)" in page
        assert "(r.csv)" in page
        assert "sonarmap reproduce gaussian --scene floodgate --grid 128 --sigma2 1 --seeds 2 --seed 4" in page


class TestFolder:
    def test_a_file_that_cannot_be_written_leaves_the_former_ones(self, tmp_path: Path) -> None:
        former = write_gaussian(tmp_path, result_of({0: [8]}))
        before = former[0].read_bytes()
        (tmp_path / "gaussian.md").unlink()
        (tmp_path / "gaussian.md").mkdir()
        with pytest.raises(InputError, match=r"gaussian\.md"):
            write_gaussian(tmp_path, result_of({0: [2]}))
        assert former[0].read_bytes() == before
        assert sorted(path.name for path in tmp_path.iterdir()) == ["gaussian.csv", "gaussian.md", "gaussian.png"]


class TestParameters:
    def test_about_the_grids_center_they_are_the_papers_rows(self) -> None:
        """Row 8 of Table 1, as printed: x y z 36 72 108, yaw roll pitch 54 18 9."""
        truth = table1_pair(8, seed=0, sigma2=1.0)[2]
        assert parameters(truth) == pytest.approx([36, 72, 108, 54, 18, 9], abs=1e-9)
        assert np.allclose(about_center(truth).as_matrix(), table1_transform(8).as_matrix())


class TestSettings:
    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            ({"scene": "moon"}, "no scene is called 'moon'"),
            ({"sigma2": (-1.0,)}, "--sigma2"),
            ({"sigma2": (float("nan"),)}, "--sigma2"),
            ({"sigma2": ()}, "--sigma2"),
            ({"seeds": 0}, "at least one"),
            ({"edge": 100}, "--grid 100"),
        ],
    )
    def test_refusals(self, arguments: dict[str, object], words: str) -> None:
        with pytest.raises(InputError, match=words):
            GaussianSettings(**arguments)  # pyright: ignore[reportArgumentType]

    def test_a_cube_as_large_as_the_papers(self) -> None:
        assert {GaussianSettings(edge=edge).grid.extent for edge in (64, 128, 256)} == {256.0}


class TestCommand:
    def test_an_unknown_experiment(self, tmp_path: Path) -> None:
        shown = CliRunner().invoke(app, ["reproduce", "alchemy", "-o", str(tmp_path / "out")])
        assert shown.exit_code == 2
        assert "no experiment is called 'alchemy'; there is gaussian" in shown.stderr
        assert not (tmp_path / "out").exists()

    def test_a_folder_that_cannot_be_written_is_told_first(self, tmp_path: Path) -> None:
        (tmp_path / "out").write_text("a file")
        shown = CliRunner().invoke(app, ["reproduce", "gaussian", "-o", str(tmp_path / "out")])
        assert shown.exit_code == 2
        assert "cannot write" in shown.stderr

    def test_the_same_seed_gives_the_same_rows(self, tmp_path: Path) -> None:
        """All but the seconds; and every file is there, with every registration in it."""
        arguments = ["reproduce", "gaussian", "--quick", "--grid", "32", "--seed", "2"]
        first = CliRunner().invoke(app, [*arguments, "-o", str(tmp_path / "a"), "--json"])
        second = CliRunner().invoke(app, [*arguments, "-o", str(tmp_path / "b")])
        assert (first.exit_code, first.stderr, second.exit_code) == (0, "", 0)
        assert "registering: 10 of 10" in second.stderr
        assert "The last scan that succeeds" in second.stdout
        rows = [rows_without_seconds(tmp_path / folder / "gaussian.csv") for folder in "ab"]
        assert rows[0] == rows[1]
        assert rows[0][0] == list(COLUMNS[:-1])
        assert len(rows[0]) == 1 + TABLE1_COUNT * len(METHODS)
        assert sorted(path.name for path in (tmp_path / "a").iterdir()) == [
            "gaussian.csv",
            "gaussian.md",
            "gaussian.png",
        ]
        assert (tmp_path / "a/gaussian.png").read_bytes().startswith(b"\x89PNG")
        printed = json.loads(first.stdout)
        assert printed["settings"]["sigma2"] == [1.0]
        assert [summary["method"] for summary in printed["summary"]] == list(METHODS)


def rows_without_seconds(path: Path) -> list[list[str]]:
    with path.open(newline="") as file:
        return [row[:-1] for row in csv.reader(file)]
