"""Several processes that share the jobs give the rows of one, and a method's jobs stay done when another changes."""

from pathlib import Path

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce.experiment import Outcome
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.run import RunOptions, run
from sonarmap.tools.lab.reproduce.worker import WorkerProcesses
from tests.samples.experiments.fake_experiment import JOBS, Fake, origin
from tests.tools.lab.reproduce.test_run import silence


def workers(count: int, scene: str | None = None) -> RunOptions:
    return RunOptions(
        workers=WorkerProcesses(count, "tests.samples.experiments.ending_experiment", Request(scene=scene), device=None)
    )


class TestWorkers:
    def test_rows_are_those_of_one_process(self, tmp_path: Path) -> None:
        fake = Fake()
        alone = run(fake, origin(fake), tmp_path / "alone", silence)
        shared = run(Fake(), origin(fake), tmp_path / "shared", silence, workers(2))
        # by text, as one of the values is NaN
        assert str(list(shared.outcomes.items())) == str(list(alone.outcomes.items()))
        assert list(shared.job_seconds) == list(JOBS)

    def test_jobs_that_are_done_are_kept_and_the_rest_run_later(self, tmp_path: Path) -> None:
        with pytest.raises(KeyboardInterrupt):
            run(Fake(), origin(Fake()), tmp_path, silence, workers(1, scene="c"))
        again = Fake()
        result = run(again, origin(again), tmp_path, silence)
        # "d" was queued behind "c", and is kept if the worker was done with it before this process saw the interrupt
        assert again.ran in (["c", "d", "e"], ["c", "e"])
        assert list(result.outcomes) == list(JOBS)

    def test_the_error_of_a_job_is_raised(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="no scene is called 'b'"):
            run(Fake(), origin(Fake()), tmp_path, silence, workers(1, scene="error b"))

    def test_a_killed_process_is_an_error(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="use fewer"):
            run(Fake(), origin(Fake()), tmp_path, silence, workers(1, scene="kill b"))


class Two(Fake):
    """Jobs of two methods in two batches."""

    def jobs(self) -> list[str]:
        return [f"{batch}/{method}" for batch in "ab" for method in ("mine", "yours")]

    def run(self, job: str) -> Outcome:
        self.ran.append(job)
        return Outcome(({"job": job},))


def test_a_change_of_one_method_leaves_the_other_done(tmp_path: Path) -> None:
    def jobs_run(mine: str) -> list[str]:
        two = Two()
        result = run(two, origin(two, methods={"mine": mine, "yours": "same"}), tmp_path, silence)
        assert list(result.outcomes) == ["a/mine", "a/yours", "b/mine", "b/yours"]
        return two.ran

    assert jobs_run("first") == ["a/mine", "a/yours", "b/mine", "b/yours"]
    assert jobs_run("first") == []
    assert jobs_run("second") == ["a/mine", "b/mine"]
