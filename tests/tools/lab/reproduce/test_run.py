"""An experiment that is stopped at any moment goes on where it was, and its results do not show it."""

import math
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.journal import Journal, JournalEntry
from sonarmap.tools.lab.reproduce.experiment import Outcome
from sonarmap.tools.lab.reproduce.pages.folder import write_experiment
from sonarmap.tools.lab.reproduce.run import JOURNAL, RunOptions, run
from sonarmap.tools.methods.fingerprint import ROOT
from tests.samples.experiments.fake_experiment import JOBS, Fake, FakeSettings, origin

ALIKE = ("fake.csv", "fake.md", "fake.png", "fake-2.png")
KILLED = f"""
import sys; sys.path.insert(0, {str(ROOT)!r})
from contextlib import nullcontext
from pathlib import Path
from tests.samples.experiments.fake_experiment import Fake, origin
from sonarmap.tools.lab.reproduce.run import run
fake = Fake(stop="d", by="kill")
run(fake, origin(fake), Path(sys.argv[1]), lambda *_: nullcontext(lambda _: None))
"""


@contextmanager
def silence(_label: str, _total: int) -> Iterator:
    yield lambda _note: None


def complete(folder: Path, fake: Fake | None = None, fresh: bool = False) -> tuple[Fake, list[str]]:
    """Run to the end and write; the experiment, and what was said."""
    fake, said = fake or Fake(), []
    result = run(fake, origin(fake), folder, silence, RunOptions(fresh), said.append)
    write_experiment(folder, fake, result, origin(fake), "sonarmap reproduce fake")
    return fake, said


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in ALIKE}


class TestStopping:
    def test_killed_and_resumed_gives_the_bytes_of_an_undisturbed_run(self, tmp_path: Path) -> None:
        killed = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "killed")], capture_output=True)
        assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()
        resumed, said = complete(tmp_path / "killed")
        undisturbed, _ = complete(tmp_path / "whole")
        assert (resumed.ran, undisturbed.ran) == (["d", "e"], list(JOBS))
        assert said == ["fake: going on: 3 of 5 jobs were done"]
        assert bytes_of(tmp_path / "killed") == bytes_of(tmp_path / "whole")

    def test_an_interrupt_loses_only_the_job_that_is_being_run(self, tmp_path: Path) -> None:
        fake = Fake(stop="c")
        with pytest.raises(KeyboardInterrupt):
            run(fake, origin(fake), tmp_path, silence)
        assert complete(tmp_path)[0].ran == ["c", "d", "e"]

    def test_jobs_that_are_done_are_not_run_again_but_with_fresh(self, tmp_path: Path) -> None:
        complete(tmp_path)
        again, said = complete(tmp_path)
        assert (again.ran, said) == ([], ["fake: 5 of 5 jobs were done before"])
        assert complete(tmp_path, fresh=True)[0].ran == list(JOBS)

    def test_fresh_leaves_the_rows_of_other_experiments(self, tmp_path: Path) -> None:
        complete(tmp_path, Fake(FakeSettings(seed=2)))
        complete(tmp_path, fresh=True)
        assert complete(tmp_path, Fake(FakeSettings(seed=2)))[0].ran == []

    def test_a_folder_that_cannot_be_written(self, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("")
        with pytest.raises(InputError, match="cannot write"):
            complete(tmp_path / "file")

    def test_a_damaged_entry_is_computed_again(self, tmp_path: Path) -> None:
        complete(tmp_path)
        before = bytes_of(tmp_path)
        with sqlite3.connect(tmp_path / JOURNAL) as database:
            database.execute("UPDATE entry SET content = '[1]' WHERE label = 'fake c'")
        database.close()
        again, said = complete(tmp_path)
        assert again.ran == ["c"]
        assert f"1 results in {tmp_path / JOURNAL} are damaged: their jobs are run again" in said[0]
        assert bytes_of(tmp_path) == before

    @pytest.mark.parametrize("content", ["[1]", "[" * 100_000])
    def test_an_entry_that_cannot_be_read_is_the_journals_fault(self, tmp_path: Path, content: str) -> None:
        fake, _ = complete(tmp_path)
        with Journal(tmp_path / JOURNAL) as journal:
            journal.add([JournalEntry(origin(fake).key("c"), "fake c", content, 1.0)])
        with pytest.raises(InputError, match=r"journal\.sqlite is not a journal of sonarmap, or it is damaged"):
            complete(tmp_path)


class Numbers(Fake):
    """One job whose outcome a test gives."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__()
        self.outcome = outcome

    def jobs(self) -> list[str]:
        return ["a"]

    def run(self, job: str) -> Outcome:
        self.ran.append(job)
        return self.outcome


class TestNumbers:
    def test_they_come_back_bit_by_bit(self, tmp_path: Path) -> None:
        row = {"a": 0.1 + 0.2, "b": 1 / 3, "c": 5e-324, "d": 2**63, "e": True, "f": "S0 | \u2028 \r\n", "g": -0.0}
        numbers = Numbers(Outcome((row,), ({"s": 0.5},)))
        for _ in range(2):
            outcome = run(numbers, origin(numbers), tmp_path, silence).outcomes["a"]
            assert outcome == numbers.outcome
            assert [type(value) for value in outcome.rows[0].values()] == [type(value) for value in row.values()]
            assert math.copysign(1, float(outcome.rows[0]["g"])) == -1
        assert numbers.ran == ["a"]

    def test_nan_stays_nan_and_infinity_becomes_it(self, tmp_path: Path) -> None:
        numbers = Numbers(Outcome(({"x": math.nan, "y": math.inf},)))
        for _ in range(2):
            row = run(numbers, origin(numbers), tmp_path, silence).outcomes["a"].rows[0]
            assert all(math.isnan(float(row[key])) for key in "xy")

    def test_a_journal_tells_what_its_entries_are_of(self, tmp_path: Path) -> None:
        complete(tmp_path)
        with Journal(tmp_path / JOURNAL) as journal:
            entry = journal.entry(origin(Fake()).key("c"))
        assert entry is not None
        assert entry.label == "fake c"
