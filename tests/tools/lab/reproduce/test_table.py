"""The paper's experiments: what counts as right, how it is counted, and how it is told."""

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from sonarmap.tools.command.main import app
from sonarmap.tools.lab.reproduce.rows import wilson
from sonarmap.tools.lab.reproduce.table import Table, write_csv
from tests.samples.surveys import CENTER, scored


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


class TestScoredRegistration:
    def test_the_bounds(self) -> None:
        assert scored().right
        assert scored(shift=5.99).right
        assert not scored(shift=6.01).right
        assert scored(shift=2.9, voxel=1.0).right
        assert not scored(shift=3.1, voxel=1.0).right
        assert not scored(yaw=6.1).right

    def test_the_sensor_decides_and_the_center_is_told(self) -> None:
        """Turned about the scan's center by 5.9 degrees, the sensor is off by what 43 m of lever make of it."""
        turned = scored(yaw=5.9, voxel=1.0)
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
        assert scored(**off).wrong_step == step


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
        write_csv(tmp_path / "a.csv", ("a", "b", "c", "d"), [(True, -1e-9, 3, "S0, S1"), (False, float("nan"), -4, "")])
        assert (tmp_path / "a.csv").read_bytes() == b'a,b,c,d\n1,0.0000,3,"S0, S1"\n0,,-4,\n'


@pytest.mark.parametrize("scene", ["pool", "moon"])
def test_scenes_that_the_papers_steps_do_not_fit_are_refused(scene: str, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["reproduce", "gaussian", "--scene", scene, "-o", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert not (tmp_path / "out").exists()
