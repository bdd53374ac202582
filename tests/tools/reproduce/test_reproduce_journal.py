"""An experiment that is stopped at any moment goes on where it was, and nobody sees it in the results."""

import math
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from kernels.errors import InputError
from tests.samples.fake_experiment import JOBS, Fake, FakeSettings, origin
from tools.methods.sources import ROOT, imported
from tools.reproduce.experiment import Outcome
from tools.reproduce.journal import Journal
from tools.reproduce.pages.folder import write_experiment
from tools.reproduce.provenance import Provenance, source_digest
from tools.reproduce.run import Way, run

ALIKE = ("fake.csv", "fake.md", "fake.png", "fake-2.png")

TESTS = Path(__file__).parent
KILLED = f"""
import sys; sys.path[:0] = [{str(ROOT)!r}, {str(TESTS)!r}]
from contextlib import nullcontext
from pathlib import Path
from tests.samples.fake_experiment import Fake, origin
from tools.reproduce.run import run
fake = Fake(stop="d", by="kill")
run(fake, origin(fake), Path(sys.argv[1]), lambda *_: nullcontext(lambda _: None))
"""


@contextmanager
def silence(_label: str, _total: int) -> Iterator:
    yield lambda _note: None


def complete(folder: Path, fake: Fake | None = None, fresh: bool = False) -> tuple[Fake, list[str]]:
    """Run to the end and write; the experiment, and what was told."""
    fake, told = fake or Fake(), []
    result = run(fake, origin(fake), folder, silence, Way(fresh), told.append)
    write_experiment(folder, fake, result, origin(fake), "sonarmap reproduce fake")
    return fake, told


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in ALIKE}


def journal_of(folder: Path) -> Path:
    return next((folder / ".journal").iterdir())


class TestStopping:
    def test_killed_and_resumed_gives_the_bytes_of_an_undisturbed_run(self, tmp_path: Path) -> None:
        killed = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "killed")], capture_output=True)
        assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()
        resumed, told = complete(tmp_path / "killed")
        undisturbed, _ = complete(tmp_path / "whole")
        assert (resumed.ran, undisturbed.ran) == (["d", "e"], list(JOBS))
        assert told == ["fake: going on: 3 of 5 jobs were done"]
        assert bytes_of(tmp_path / "killed") == bytes_of(tmp_path / "whole")

    def test_interrupted_loses_the_job_under_way_alone(self, tmp_path: Path) -> None:
        fake = Fake(stop="c")
        with pytest.raises(KeyboardInterrupt):
            run(fake, origin(fake), tmp_path, silence)
        assert complete(tmp_path)[0].ran == ["c", "d", "e"]

    @pytest.mark.parametrize("torn", [1, 7, -1])
    def test_a_torn_last_line_is_dropped(self, tmp_path: Path, torn: int) -> None:
        complete(tmp_path)
        before, journal = bytes_of(tmp_path), journal_of(tmp_path)
        lines = journal.read_bytes().splitlines(keepends=True)
        assert len(lines) == 1 + len(JOBS)
        journal.write_bytes(b"".join(lines[:-1]) + lines[-1][:torn])
        assert complete(tmp_path)[0].ran == ["e"]
        assert bytes_of(tmp_path) == before
        assert complete(tmp_path)[0].ran == []

    @pytest.mark.parametrize("damage", [b"\0\0\0\n", b"[1]\n", b'{"job": "b"}\n'])
    def test_from_a_damaged_line_on_jobs_are_done_again(self, tmp_path: Path, damage: bytes) -> None:
        complete(tmp_path)
        journal = journal_of(tmp_path)
        lines = journal.read_bytes().splitlines(keepends=True)
        journal.write_bytes(b"".join([*lines[:2], damage, *lines[3:]]))
        assert complete(tmp_path)[0].ran == ["b", "c", "d", "e"]

    def test_a_torn_first_line_is_a_new_start(self, tmp_path: Path) -> None:
        complete(tmp_path)
        journal = journal_of(tmp_path)
        journal.write_bytes(journal.read_bytes()[:20])
        assert complete(tmp_path)[0].ran == list(JOBS)

    def test_all_done_is_told_and_fresh_starts_anew(self, tmp_path: Path) -> None:
        complete(tmp_path)
        again, told = complete(tmp_path)
        assert (again.ran, told) == ([], ["fake: 5 of 5 jobs were done before"])
        assert complete(tmp_path, fresh=True)[0].ran == list(JOBS)

    def test_a_folder_that_cannot_be_written(self, tmp_path: Path) -> None:
        (tmp_path / ".journal").write_text("a file")
        with pytest.raises(InputError, match="cannot write"):
            complete(tmp_path)


class TestNumbers:
    def test_they_come_back_bit_by_bit(self, tmp_path: Path) -> None:
        numbers = {"a": 0.1 + 0.2, "b": 1 / 3, "c": 5e-324, "d": 2**63, "e": True, "f": "S0 | \u2028 \r\n", "g": -0.0}
        Journal(tmp_path, origin(Fake())).add("a", Outcome((numbers,), ({"s": 0.5},)), 1.5)
        read = Journal(tmp_path, origin(Fake())).done["a"]
        assert read.outcome == Outcome((numbers,), ({"s": 0.5},))
        assert [type(value) for value in read.outcome.rows[0].values()] == [type(value) for value in numbers.values()]
        assert math.copysign(1, float(read.outcome.rows[0]["g"])) == -1
        assert read.seconds == 1.5

    def test_nan_stays_nan_and_infinity_becomes_it(self, tmp_path: Path) -> None:
        journal = Journal(tmp_path, origin(Fake()))
        journal.add("a", Outcome(({"x": math.nan, "y": math.inf},)), 0.0)
        rows = [one.done["a"].outcome.rows[0] for one in (journal, Journal(tmp_path, origin(Fake())))]
        assert all(math.isnan(float(row[key])) for row in rows for key in "xy")


class TestFingerprint:
    @pytest.mark.parametrize(
        "changes",
        [
            {"settings": {"seed": 2, "fast": False}},
            {"sources": "cd"},
            {"device": "another"},
            {"platform": "OpenCL 1.2"},
            {"versions": {"numpy": "3"}},
            {"name": "other"},
        ],
    )
    def test_rows_of_anything_else_are_not_taken_over(self, tmp_path: Path, changes: dict[str, object]) -> None:
        one, other = origin(Fake()), origin(Fake(), **changes)
        assert one.fingerprint != other.fingerprint
        Journal(tmp_path, one).add("a", Outcome(({"x": 1.0},)), 0.0)
        assert Journal(tmp_path, other).done == {}
        assert Journal(tmp_path, one).done.keys() == {"a"}

    def test_the_host_decides_nothing(self) -> None:
        assert origin(Fake()).fingerprint == origin(Fake(), processor="another", cores=64).fingerprint

    def test_other_settings_are_other_jobs(self, tmp_path: Path) -> None:
        complete(tmp_path)
        assert complete(tmp_path, Fake(FakeSettings(seed=2)))[0].ran == list(JOBS)

    def test_the_place_in_words(self) -> None:
        assert origin(Fake()).place == "a device (OpenCL 3.0 X; a processor, 2 cores)"


class TestSources:
    @pytest.fixture
    def project(self, tmp_path: Path) -> Path:
        files = {
            "kernels/fft.cl": "__kernel",
            "spectral/grid.py": "x = 1",
            "tools/__init__.py": "",
            "tools/reproduce/__init__.py": "",
            "tools/reproduce/one.py": "from tools.reproduce import rows\nfrom tools.reproduce.one_figure import draw\n",
            "tools/reproduce/rows.py": "def f():\n    import tools.extra\nMETHODS = 'tools.named:Method'\n",
            "tools/named.py": "from spectral.grid import x",
            "tools/reproduce/one_figure.py": "import tools.picture",
            "tools/reproduce/other.py": "",
            "tools/extra.py": "",
            "tools/picture.py": "",
        }
        for name, text in files.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(text)
        return tmp_path

    @pytest.mark.parametrize(
        ("name", "decides"),
        [
            ("kernels/fft.cl", True),
            ("spectral/grid.py", True),
            ("tools/reproduce/one.py", True),
            ("tools/reproduce/rows.py", True),
            ("tools/extra.py", True),
            ("tools/named.py", True),
            ("tools/reproduce/one_figure.py", False),
            ("tools/picture.py", False),
            ("tools/reproduce/other.py", False),
        ],
    )
    def test_what_decides_rows(self, project: Path, name: str, decides: bool) -> None:
        one = project / "tools/reproduce/one.py"
        before = source_digest(one, project)
        assert source_digest(one, project) == before
        (project / name).write_text((project / name).read_text() + "\n# a comment")
        assert (source_digest(one, project) != before) is name.endswith(".cl")
        (project / name).write_text((project / name).read_text() + "\ny = 2")
        assert (source_digest(one, project) != before) is decides

    def test_a_new_program_counts(self, project: Path) -> None:
        one = project / "tools/reproduce/one.py"
        before = source_digest(one, project)
        (project / "kernels/more.cl").write_text("")
        assert source_digest(one, project) != before

    def test_table_1_depends_on_its_methods_and_not_on_its_tables(self) -> None:
        found = {path.relative_to(ROOT).as_posix() for path in imported([ROOT / "tools/reproduce/gaussian/run.py"])}
        assert {"tools/reproduce/gaussian/row.py", "spectral/hemisphere/layers.py"} <= found
        assert not found & {"tools/reproduce/gaussian/section.py", "tools/reproduce/gaussian/figure.py"}


def test_provenance_survives_json() -> None:
    from tools.writers.json_text import to_json

    assert Provenance(**to_json(origin(Fake()))) == origin(Fake())
