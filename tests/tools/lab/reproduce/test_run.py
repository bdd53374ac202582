"""Runs of experiments: stopping, resuming, keys of results, and worker processes."""

import math
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.tables import to_json
from sonarmap.tools.lab.reproduce.experiments import EXPERIMENTS, Experiment, Outcome, Request, WorkerProcesses, create
from sonarmap.tools.lab.reproduce.folder import write_experiment
from sonarmap.tools.lab.reproduce.registrations import EVALUATED
from sonarmap.tools.lab.reproduce.run import JOURNAL, Provenance, RunOptions, provenance, run
from sonarmap.tools.methods.fingerprint import ROOT, source_digest
from tests.samples.experiments import fake_experiment
from tests.samples.experiments.fake_experiment import JOBS, fake, origin
from tests.samples.experiments.real_folders import put

pytestmark = pytest.mark.usefixtures("faked")
REPRODUCIBLE = ("fake.csv", "fake.md")
KILLED = f"""
import sys; sys.path.insert(0, {str(ROOT.parent)!r})
from contextlib import nullcontext
from pathlib import Path
from tests.samples.experiments.fake_experiment import fake, origin
from sonarmap.tools.lab.reproduce.run import run
killed = fake(end="kill d")
run(killed, origin(killed), Path(sys.argv[1]), lambda *_: nullcontext(lambda _: None))
"""


@contextmanager
def silence(_label: str, _total: int) -> Iterator:
    yield lambda _note: None


def complete(folder: Path, experiment: Experiment | None = None, fresh: bool = False) -> tuple[list[str], list[str]]:
    """Run an experiment and write its files; the jobs that ran, and the notes."""
    experiment, notes = experiment or fake(), []
    fake_experiment.ran.clear()
    result = run(experiment, origin(experiment), folder, silence, RunOptions(fresh), notes.append)
    write_experiment(folder, experiment, result, result.rows, origin(experiment), "sonarmap reproduce fake")
    return [*fake_experiment.ran], notes


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in REPRODUCIBLE}


class TestStopping:
    def test_killed_and_resumed_gives_the_bytes_of_an_undisturbed_run(self, tmp_path: Path) -> None:
        killed = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "killed")], capture_output=True)
        assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()
        resumed, notes = complete(tmp_path / "killed")
        undisturbed, _ = complete(tmp_path / "whole")
        assert (resumed, undisturbed) == (["d", "e"], list(JOBS))
        assert notes == ["fake: continuing: 3 of 5 jobs were done"]
        assert bytes_of(tmp_path / "killed") == bytes_of(tmp_path / "whole")

    def test_finished_jobs_run_again_only_with_fresh(self, tmp_path: Path) -> None:
        complete(tmp_path, fake(seed=2))
        complete(tmp_path)
        assert complete(tmp_path) == ([], ["fake: 5 of 5 jobs were done before"])
        assert complete(tmp_path, fresh=True)[0] == list(JOBS)
        assert complete(tmp_path, fake(seed=2))[0] == []

    def test_a_damaged_entry_is_computed_again(self, tmp_path: Path) -> None:
        complete(tmp_path)
        before = bytes_of(tmp_path)
        with closing(sqlite3.connect(tmp_path / JOURNAL)) as database, database:
            database.execute("UPDATE entry SET content = '[1]' WHERE label = 'fake c'")
        again, notes = complete(tmp_path)
        assert again == ["c"]  # the job in its label
        assert f"1 results in {tmp_path / JOURNAL} are damaged: their jobs are run again" in notes[0]
        assert bytes_of(tmp_path) == before


def test_finite_numbers_are_read_exactly_and_others_as_nan(tmp_path: Path) -> None:
    row = {"a": 0.1 + 0.2, "b": 1 / 3, "c": 5e-324, "d": 2**63, "e": True, "f": "S0 | \u2028 \r\n", "g": -0.0}
    strange = Outcome(({"x": math.nan, "y": math.inf},))
    whole = Outcome((row,), ({"s": 0.5},))
    given = fake(outcomes={"a": whole, "b": strange})
    fake_experiment.ran.clear()
    for _ in range(2):
        outcomes = run(given, origin(given), tmp_path, silence).outcomes
        assert outcomes["a"] == whole
        assert [type(value) for value in outcomes["a"].rows[0].values()] == [type(value) for value in row.values()]
        assert math.copysign(1, float(outcomes["a"].rows[0]["g"])) == -1
        assert all(math.isnan(float(value)) for value in outcomes["b"].rows[0].values())
    assert fake_experiment.ran == ["a", "b"]


class TestKey:
    @pytest.mark.parametrize(
        "changes",
        [
            {"settings": {"seed": 2}},
            {"sources": "cd"},
            {"device": "another"},
            {"platform": "OpenCL 1.2"},
            {"versions": {"numpy": "3"}},
            {"name": "other"},
        ],
    )
    def test_the_key_depends_on_all_that_changes_rows_but_not_on_the_host(self, changes: dict[str, object]) -> None:
        assert origin(fake()).key("a") != origin(fake(), **changes).key("a")
        assert origin(fake()).key("a") == origin(fake(), processor="another", cores=64).key("a")
        assert Provenance(**to_json(origin(fake(), **changes))) == origin(fake(), **changes)

    def test_jobs_of_a_method_depend_on_its_fingerprint_alone(self) -> None:
        before = origin(fake(), methods={"mine": "1", "yours": "1"})
        after = origin(fake(), methods={"mine": "2", "yours": "1"}, device="another", settings={"seed": 2})
        assert before.key("a/mine") != after.key("a/mine")
        assert before.key("a/yours") == after.key("a/yours") != before.key("b/yours")


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_names_its_sources(name: str, device: Device, tmp_path: Path) -> None:
    folder = put(tmp_path) if EXPERIMENTS[name].folder else None
    experiment = create(name, Request(device=device, quick=True, folder=folder))
    module = EXPERIMENTS[name].module.partition(":")[0].removeprefix("sonarmap.").replace(".", "/")
    assert f"{module}.py" in experiment.sources or name == "confidence"  # it is fitted anew each time
    assert source_digest(experiment.sources)
    digests = provenance(experiment, device).methods
    assert any(method in digests for method in EVALUATED) is (name in ("pairs", "real", "kinds"))
    assert len(set(digests.values())) == len(digests)


def workers(count: int, scene: str | None = None) -> RunOptions:
    return RunOptions(
        workers=WorkerProcesses(count, "tests.samples.experiments.fake_experiment", Request(scene=scene), device=None)
    )


class TestWorkers:
    @pytest.mark.slow
    def test_workers_give_the_rows_of_one_process(self, tmp_path: Path) -> None:
        alone = run(fake(), origin(fake()), tmp_path / "alone", silence)
        shared = run(fake(), origin(fake()), tmp_path / "shared", silence, workers(2))
        # by text, as one of the values is NaN
        assert str(list(shared.outcomes.items())) == str(list(alone.outcomes.items()))
        assert list(shared.job_seconds) == list(JOBS)

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("scene", "words"), [("error b", "no scene is called 'b'"), ("kill b", "use fewer")], ids=["error", "killed"]
    )
    def test_a_failed_job_and_a_killed_process_are_errors(self, tmp_path: Path, scene: str, words: str) -> None:
        with pytest.raises(InputError, match=words):
            run(fake(), origin(fake()), tmp_path, silence, workers(1, scene=scene))
