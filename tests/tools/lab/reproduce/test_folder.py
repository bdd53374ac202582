"""The files of an experiment, and the command that makes them."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.main import app
from sonarmap.tools.lab.reproduce.folder import write_rows
from sonarmap.tools.lab.reproduce.run import JOURNAL
from tests.samples.experiments import fake_experiment
from tests.samples.experiments.fake_experiment import fake
from tests.tools.lab.reproduce.test_run import REPRODUCIBLE, bytes_of, complete

pytestmark = pytest.mark.usefixtures("faked")
FILES = {*REPRODUCIBLE, "fake-seconds.csv", "fake-times.md", "fake.json"}


def reproduce(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["reproduce", *arguments])


def files_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if path.name != JOURNAL}


class TestFolder:
    def test_all_files_are_written_or_none(self, tmp_path: Path) -> None:
        complete(tmp_path)
        before = bytes_of(tmp_path)
        (tmp_path / "fake.md").unlink()
        (tmp_path / "fake.md").mkdir()
        with pytest.raises(InputError, match=r"fake\.md"):
            complete(tmp_path, fake(seed=3))
        (tmp_path / "fake.md").rmdir()
        (tmp_path / "fake.md").write_bytes(before["fake.md"])
        assert bytes_of(tmp_path) == before
        assert files_in(tmp_path) == FILES

    def test_cells_of_csv_files(self, tmp_path: Path) -> None:
        rows = [{"a": True, "b": -1e-9, "c": 3, "d": "S0, S1"}, {"a": False, "b": float("nan"), "c": -4}]
        write_rows(tmp_path / "a.csv", rows)
        assert (tmp_path / "a.csv").read_bytes() == b'a,b,c,d\n1,0.0000,3,"S0, S1"\n0,,-4,\n'


class TestCommand:
    def test_the_command_writes_all_files(self, tmp_path: Path) -> None:
        arguments = ["fake", "--seed", "3", "-o", str(tmp_path / "out")]
        shown = reproduce(*arguments)
        assert (shown.exit_code, shown.exception) == (0, None)
        assert "fake: 5 of 5" in shown.stderr
        assert "fake: Fig. 0" in shown.stdout
        assert files_in(tmp_path / "out") == FILES
        assert "\nsonarmap reproduce fake --seed 3\n" in (tmp_path / "out" / "fake.md").read_text()
        assert reproduce(*arguments).stderr == "fake: 5 of 5 jobs were done before\n"

    def test_json_has_tables_and_files(self, tmp_path: Path) -> None:
        shown = reproduce("fake", "-o", str(tmp_path), "--json")
        assert (shown.exit_code, shown.stderr) == (0, "")
        printed = json.loads(shown.stdout)["experiments"][0]
        assert printed["name"] == "fake"
        assert printed["tables"][1]["headings"] == ["high", "mean"]
        assert {Path(name).name for name in printed["files"]} == FILES

    def test_an_interrupted_run_is_resumed(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(fake_experiment, "create", lambda _: fake(end="interrupt d"))
        shown = reproduce("fake", "-o", str(tmp_path))
        assert shown.exit_code == 130
        assert "stopped: finished jobs are kept in" in shown.stderr
        monkeypatch.setattr(fake_experiment, "create", lambda _: fake())
        shown = reproduce("fake", "-o", str(tmp_path))
        assert "continuing: 3 of 5 jobs were done" in shown.stderr
        assert files_in(tmp_path) == FILES

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (["alchemy"], "no experiment is called 'alchemy'"),
            (["fake", "--grid", "64"], "--grid has no effect on reproduce fake; leave it out. It takes --seed"),
            (["fake"], "cannot write"),
        ],
    )
    def test_unusable_arguments_are_refused(self, tmp_path: Path, arguments: list[str], words: str) -> None:
        if words == "cannot write":
            (tmp_path / "out").write_text("a file")
        shown = reproduce(*arguments, "-o", str(tmp_path / "out"))
        assert shown.exit_code == 2
        assert words in " ".join(shown.stderr.replace("│", " ").split())
        assert not (tmp_path / "out").is_dir() or files_in(tmp_path / "out") == set()
