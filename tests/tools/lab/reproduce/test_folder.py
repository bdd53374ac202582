"""The files of an experiment, and the verb that makes them."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.main import app
from sonarmap.tools.lab.reproduce import experiments
from sonarmap.tools.lab.reproduce.folder import (
    Verdict,
    duration,
    read_record,
    section_text,
    verdicts,
    write_experiment,
)
from sonarmap.tools.lab.reproduce.run import JOURNAL, run
from sonarmap.tools.lab.reproduce.table import Table
from tests.samples.experiments.fake_experiment import JOBS, Fake, origin
from tests.tools.lab.reproduce.test_run import ALIKE, bytes_of, complete, silence

FILES = {*ALIKE, "fake-seconds.csv", "fake-times.md", "fake.json"}

FAKE = experiments.ExperimentEntry("Fig. 0", "tests.samples.experiments.fake_experiment", ("seed",))


def reproduce(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["reproduce", *arguments])


def files_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if path.name != JOURNAL}


class TestFolder:
    def test_rows_and_words(self, tmp_path: Path) -> None:
        complete(tmp_path)
        assert files_in(tmp_path) == FILES
        lines = (tmp_path / "fake.csv").read_text().splitlines()
        assert lines[0] == "job,value,high,gap"
        assert [line.split(",")[0] for line in lines[1:]] == list(JOBS)
        assert lines[1].endswith(",0.3000")
        assert lines[2].endswith(",")  # NaN
        assert (tmp_path / "fake-seconds.csv").read_text().startswith("job,seconds\na,0.2500\n")
        words = (tmp_path / "fake.md").read_text()
        assert words.startswith("# A fake, Fig. 0\n\n**Claims**\n")
        assert "```sh\nsonarmap reproduce fake\n```\n" in words
        assert "| setting | value |\n" in words
        assert "a device" not in words
        assert (
            "5 jobs in 0 s on a device (OpenCL 3.0 X; a processor, 2 cores), with numpy 2."
            in (tmp_path / "fake-times.md").read_text()
        )

    def test_all_or_none(self, tmp_path: Path) -> None:
        complete(tmp_path)
        before = bytes_of(tmp_path)
        (tmp_path / "fake.md").unlink()
        (tmp_path / "fake.md").mkdir()
        fake = Fake()
        fake.settings = replace(fake.settings, seed=3)
        with pytest.raises(InputError, match=r"fake\.md"):
            complete(tmp_path, fake)
        (tmp_path / "fake.md").rmdir()
        (tmp_path / "fake.md").write_bytes(before["fake.md"])
        assert bytes_of(tmp_path) == before
        assert files_in(tmp_path) == FILES

    def test_pictures_must_be_those_of_the_section(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        fake = Fake()
        result = run(fake, origin(fake), tmp_path, silence)
        section = fake.section(fake.run("a").rows, ())
        for pictures in ({"fake.png": ""}, {"fake.png": "", "fake-2.png": "", "fake-3.png": ""}):
            monkeypatch.setattr(fake, "section", lambda *_, p=pictures: replace(section, pictures=p))
            with pytest.raises(ValueError, match=r"fake drew \['fake-2.png', 'fake.png'\]"):
                write_experiment(tmp_path, fake, result, origin(fake), "")
        assert files_in(tmp_path) == set()

    def test_a_former_runs_further_files_go(self, tmp_path: Path) -> None:
        complete(tmp_path)
        record = json.loads((tmp_path / "fake.json").read_text())
        (tmp_path / "fake-old.png").write_bytes(b"")
        (tmp_path / "mine.png").write_bytes(b"")
        record["files"].append("fake-old.png")
        (tmp_path / "fake.json").write_text(json.dumps(record))
        complete(tmp_path)
        assert files_in(tmp_path) == FILES | {"mine.png"}

    def test_a_record_comes_back_and_an_incomplete_one_does_not(self, tmp_path: Path) -> None:
        fake = Fake()
        result = run(fake, origin(fake), tmp_path, silence)
        written = write_experiment(tmp_path, fake, result, origin(fake), "the command")
        assert read_record(tmp_path, "fake") == written
        (tmp_path / "fake-2.png").unlink()
        assert read_record(tmp_path, "fake") is None
        (tmp_path / "fake.json").write_text("{}")
        assert read_record(tmp_path, "fake") is None


class TestVerdicts:
    SECTION = Fake().section(Fake().run("a").rows, ())

    @pytest.mark.parametrize(
        ("headings", "cells", "expected"),
        [
            ("grid|noise|paper: yaw|ours, worst|verdict|ours, all|right", "128|2|S8|S7|no|S9|1/2", "128, 2|S8|S7|no"),
            ("measure|ours|others|what follows", "it|none|all|no", "it|all|none|no"),
        ],
    )
    def test_columns_are_found_by_their_first_word(self, headings: str, cells: str, expected: str) -> None:
        """Where other methods are compared, they stand in the paper's place."""
        table = Table("t", tuple(headings.split("|")), (tuple(cells.split("|")),))
        assert verdicts(replace(self.SECTION, tables=(table,)))[0] == Verdict(*expected.split("|"))

    def test_a_section_without_them_has_no_table_or_is_refused(self) -> None:
        assert verdicts(replace(self.SECTION, tables=())) == ()
        with pytest.raises(ValueError, match="begins with the word 'verdict"):
            verdicts(replace(self.SECTION, tables=(Table("t", ("paper", "ours"), ()),)))

    def test_a_section_and_durations(self) -> None:
        text = section_text(self.SECTION)
        assert text.startswith("# A fake, Fig. 0\n")
        assert "![The numbers.](fake.png)" in text
        assert [duration(seconds) for seconds in (0.4, 99.4, 130, 3599, 11100)] == [
            *("0 s", "99 s", "2 min", "1 h 00 min", "3 h 05 min")
        ]


class TestOptions:
    def test_what_is_made_is_what_was_asked_for(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(experiments, "EXPERIMENTS", {"fake": FAKE})
        asked = experiments.Request(seed=7, quick=True)
        assert experiments.create("fake", asked).settings == replace(Fake().settings, seed=7, fast=True)


class TestCommand:
    @pytest.fixture(autouse=True)
    def _fakes(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(experiments, "EXPERIMENTS", {"fake": FAKE})

    def test_all(self, tmp_path: Path) -> None:
        arguments = ["all", "--seed", "3", "-o", str(tmp_path / "out")]
        shown = reproduce(*arguments)
        assert (shown.exit_code, shown.exception) == (0, None)
        assert "fake: 5 of 5" in shown.stderr
        assert "A fake, Fig. 0" in shown.stdout
        assert files_in(tmp_path / "out") == FILES
        assert "\nsonarmap reproduce fake --seed 3\n" in (tmp_path / "out" / "fake.md").read_text()
        assert reproduce(*arguments).stderr == "fake: 5 of 5 jobs were done before\n"

    def test_json(self, tmp_path: Path) -> None:
        shown = reproduce("fake", "-o", str(tmp_path), "--json")
        assert (shown.exit_code, shown.stderr) == (0, "")
        printed = json.loads(shown.stdout)["experiments"][0]
        assert printed["name"] == "fake"
        assert printed["section"]["tables"][0]["headings"] == ["what", "paper", "ours, mean", "verdict"]
        assert {Path(name).name for name in printed["files"]} == FILES

    @pytest.mark.slow
    def test_workers_change_nothing_but_where_times_are_measured(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        shown = reproduce("fake", "-o", str(tmp_path / "two"), "--workers", "2")
        assert (shown.exit_code, shown.exception) == (0, None)
        complete(tmp_path / "one")
        assert (tmp_path / "two/fake.csv").read_bytes() == (tmp_path / "one/fake.csv").read_bytes()
        timed = experiments.ExperimentEntry("Fig. 0", "no_such_module_in_a_process", ("seed",), timed=True)
        monkeypatch.setattr("sonarmap.tools.command.verbs.reproduce.create", lambda *_: Fake())
        monkeypatch.setattr(experiments, "EXPERIMENTS", {"fake": timed})
        shown = reproduce("fake", "-o", str(tmp_path / "timed"), "--workers", "2")
        assert shown.exit_code == 0
        assert "fake: measures times, so --workers has no effect" in shown.stderr

    def test_interrupted_it_says_what_is_kept(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("tests.samples.experiments.fake_experiment.create", lambda _: Fake(stop="d"))
        shown = reproduce("fake", "-o", str(tmp_path))
        assert shown.exit_code == 130
        assert "stopped: finished jobs are kept in" in shown.stderr
        monkeypatch.undo()
        monkeypatch.setattr(experiments, "EXPERIMENTS", {"fake": FAKE})
        shown = reproduce("fake", "-o", str(tmp_path))
        assert "going on: 3 of 5 jobs were done" in shown.stderr
        assert files_in(tmp_path) == FILES

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (["alchemy"], "no experiment is called 'alchemy'; there are fake, all"),
            (["fake", "--grid", "64"], "--grid has no effect on reproduce fake; leave it out. It takes --seed"),
            (["all", "--scene", "harbor"], "--scene has no effect on reproduce all"),
            (["fake", "--seed", "-1"], "--seed"),
            (["fake", "--grid", "103"], "--grid 103"),
            (["fake", "--device", "abacus"], "abacus"),
            (["fake", "--method", "alchemy"], "no method is called 'alchemy'"),
            (["fake"], "cannot write"),
        ],
    )
    def test_refused(self, tmp_path: Path, arguments: list[str], words: str) -> None:
        if words == "cannot write":
            (tmp_path / "out").write_text("a file")
        shown = reproduce(*arguments, "-o", str(tmp_path / "out"))
        assert shown.exit_code == 2
        assert words in " ".join(shown.stderr.replace("│", " ").split())
        assert not (tmp_path / "out").is_dir() or files_in(tmp_path / "out") == set()
