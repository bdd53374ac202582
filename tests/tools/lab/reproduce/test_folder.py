"""The files of an experiment, and the command that makes them."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from sonarmap.tools.command.main import app
from sonarmap.tools.lab.reproduce.folder import write_rows
from sonarmap.tools.lab.reproduce.run import JOURNAL
from tests.samples.experiments import fake_experiment
from tests.samples.experiments.fake_experiment import fake
from tests.tools.lab.reproduce.test_run import REPRODUCIBLE

pytestmark = pytest.mark.usefixtures("faked")
FILES = {*REPRODUCIBLE, "fake-seconds.csv", "fake-times.md", "fake.json"}


def reproduce(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["reproduce", *arguments])


def files_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if path.name != JOURNAL}


def test_cells_of_csv_files(tmp_path: Path) -> None:
    rows = [{"a": True, "b": -1e-9, "c": 3, "d": "S0, S1"}, {"a": False, "b": float("nan"), "c": -4}]
    write_rows(tmp_path / "a.csv", rows)
    assert (tmp_path / "a.csv").read_bytes() == b'a,b,c,d\n1,0.0000,3,"S0, S1"\n0,,-4,\n'


def test_the_command_writes_all_files_after_an_interruption_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fake_experiment, "create", lambda _: fake(end="interrupt d"))
    shown = reproduce("fake", "-o", str(tmp_path))
    assert shown.exit_code == 130
    assert "stopped: finished jobs are kept in" in shown.stderr
    monkeypatch.setattr(fake_experiment, "create", lambda _: fake())
    shown = reproduce("fake", "-o", str(tmp_path))
    assert "continuing: 3 of 5 jobs were done" in shown.stderr
    assert "fake: Fig. 0" in shown.stdout
    printed = json.loads(reproduce("fake", "-o", str(tmp_path), "--json").stdout)["experiments"][0]
    assert printed["name"] == "fake"
    assert printed["tables"][1]["headings"] == ["high", "mean"]
    assert {Path(name).name for name in printed["files"]} == files_in(tmp_path) == FILES


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["alchemy"], "no experiment is called 'alchemy'"),
        (["fake", "--grid", "64"], "--grid has no effect on reproduce fake; leave it out. It takes --seed"),
        (["fake"], "cannot write"),
    ],
)
def test_unusable_arguments_are_refused(tmp_path: Path, arguments: list[str], words: str) -> None:
    if words == "cannot write":
        (tmp_path / "out").write_text("a file")
    shown = reproduce(*arguments, "-o", str(tmp_path / "out"))
    assert shown.exit_code == 2
    assert words in " ".join(shown.stderr.replace("│", " ").split())
