"""A survey's pairs give the same results wherever they run and however often they stop; no pair runs twice."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sonarmap.kernels.errors import DeviceError, InputError
from sonarmap.slam.execute.executor import Executor
from sonarmap.slam.execute.journal import Journal
from sonarmap.slam.execute.pair_text import to_text
from sonarmap.slam.execute.processes import spawned
from sonarmap.slam.execute.runner import Execution, PairRunner
from sonarmap.slam.execute.worker import Worker
from sonarmap.slam.pair import Candidate
from tests.samples.survey_worker import Knowing, worker_spec
from tests.samples.surveys import ring_poses, scans_of

COUNT = 9
SCANS = scans_of(ring_poses(COUNT))
PAIRS = [(i, i + step) for step in (1, 2) for i in range(COUNT - step)]


class Work:
    """Registers PAIRS in a folder, with a journal, and counts."""

    def __init__(self, folder: Path) -> None:
        self.notes, self.journal = folder / "notes", folder / "journal.sqlite"

    @contextmanager
    def execution(self, kind: str, ending: str = "") -> Iterator[Execution]:
        spec = worker_spec(COUNT, self.notes, ending)
        with Journal(self.journal) as journal:
            match kind.split():
                case ["here"]:
                    here = Execution(Worker(Knowing(COUNT, self.notes, ending), 3))
                    yield replace(here, journal=journal, method="knowing")
                case ["processes", workers]:
                    with spawned(int(workers)) as pool:
                        yield Execution(spec, Executor(pool, int(workers)), journal, "knowing")

    def run(self, kind: str = "here", ending: str = "", pairs: list[tuple[int, int]] = PAIRS) -> list[str]:
        """The result of every pair, as text."""
        with self.execution(kind, ending) as execution:
            registered = PairRunner(execution, SCANS, 0, None).register(candidates(pairs))
            assert [pair.scans for pair in registered] == pairs
            return [to_text(pair.registration, pair.failure) for pair in registered]

    def registered(self) -> list[tuple[int, int]]:
        """The pairs that registrars registered, sorted; pairs with the broken scan never reach them."""
        lines = self.notes.read_text().splitlines() if self.notes.exists() else []
        return sorted((int(i), int(j)) for i, j in (line.split() for line in lines))


def candidates(pairs: list[tuple[int, int]]) -> list[Candidate]:
    return [Candidate(i, j, "loop") for i, j in pairs]


USABLE = sorted(pair for pair in PAIRS if 2 not in pair)


@pytest.fixture
def work(tmp_path: Path) -> Work:
    return Work(tmp_path)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    work = Work(tmp_path_factory.mktemp("undisturbed"))
    found = work.run()
    assert work.registered() == USABLE
    return found


def test_failures_stay_in_their_place(undisturbed: list[str]) -> None:
    failed = [pair for pair, text in zip(PAIRS, undisturbed, strict=True) if "scan2: it is of no use" in text]
    assert failed == [pair for pair in PAIRS if 2 in pair]


@pytest.mark.parametrize("kind", ["here", "processes 1"])
def test_processes_and_the_journal_give_the_same_bits(work: Work, undisturbed: list[str], kind: str) -> None:
    assert [work.run(kind) for _ in range(2)] == [undisturbed] * 2
    assert work.registered() == USABLE


def test_the_order_makes_no_difference_and_only_new_pairs_are_registered(work: Work, undisturbed: list[str]) -> None:
    order = np.random.default_rng(1).permutation(len(PAIRS)).tolist()
    some = [PAIRS[n] for n in order[:6]]
    assert work.run(pairs=some) == [undisturbed[n] for n in order[:6]]
    assert work.registered() == sorted(pair for pair in some if 2 not in pair)
    assert work.run(pairs=[PAIRS[n] for n in order]) == [undisturbed[n] for n in order]
    assert work.registered() == USABLE


def test_a_run_continues_after_every_stop(work: Work, undisturbed: list[str]) -> None:
    """Only the pairs at which the six stops happen are begun twice."""
    stops = [[pair for pair in PAIRS if 2 not in pair][k] for k in (0, 1, 4, 5, 7, 10)]
    for i, j in stops:
        with pytest.raises(KeyboardInterrupt):
            work.run(ending=f"stop {i} {j}")
    assert work.run() == undisturbed
    assert work.registered() == sorted([*USABLE, *stops])


def test_a_killed_worker_is_reported_and_finished_pairs_are_kept(work: Work, undisturbed: list[str]) -> None:
    with pytest.raises(InputError, match=r"ended early.* continues from there"):
        work.run("processes 1", ending="kill 7 8")
    begun = work.registered()
    assert len(begun) >= 4
    assert work.run() == undisturbed
    again = [pair for pair in set(begun) if work.registered().count(pair) > 1]
    assert len(again) <= 4
    assert (7, 8) in again


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("kind", ["here", "processes 2"])
def test_a_device_error_is_raised_and_not_kept(work: Work, undisturbed: list[str], kind: str) -> None:
    with pytest.raises(DeviceError, match="the device is full"):
        work.run(kind, ending="device 4 5")
    assert work.run() == undisturbed


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("kind", ["here", "processes 2"])
def test_signatures_are_kept_too(work: Work, kind: str) -> None:
    for _ in range(2):
        with work.execution(kind) as execution:
            signatures = PairRunner(execution, SCANS, 0, None).signatures()
        for scan, signature in zip(SCANS, signatures, strict=True):
            if scan.name == "scan2":
                assert signature is None
            else:
                assert signature is not None
                assert_array_equal(signature, scan.points.mean(axis=0))


class TestJournalEntries:
    def test_keys_depend_on_scans_and_method_but_not_on_names(self, work: Work) -> None:
        first = work.run(pairs=[(0, 1), (0, 2)])
        renamed = [replace(scan, name=scan.name.replace("scan", "scan0"), stamp=9.0) for scan in SCANS]
        for method, scans, new in (("knowing", renamed, [(0, 2)]), ("another", SCANS, [(0, 1), (0, 2)])):
            with work.execution("here") as execution:
                execution = replace(execution, method=method)
                registered = PairRunner(execution, scans, 0, None).register(candidates([(0, 1), (0, 2)]))
            assert to_text(registered[0].registration) == first[0]
            # a failure names its scans, so that it is computed anew
            computed = [(t.target, t.source) for t in execution.timings.pairs if not t.from_journal]
            assert computed == new


def test_timings_say_what_came_from_the_journal(work: Work) -> None:
    for from_journal in (0, len(PAIRS)):
        with work.execution("here") as execution:
            runner = PairRunner(execution, SCANS, 2, None)
            runner.register(candidates(PAIRS))
            runner.step_done("optimized")
        timings = execution.timings
        assert [(time.target, time.source) for time in timings.pairs] == PAIRS
        assert timings.from_journal == from_journal
        assert all(time.seconds > 0 and time.from_journal == (from_journal > 0) for time in timings.pairs)
        assert list(timings.stages) == ["pairs registered", "optimized"]
    # timings of a part of the survey have the survey's numbers
    with work.execution("here") as execution:
        PairRunner(execution, SCANS, 0, None).of([1, 3, 5, 8]).of([0, 1, 3]).register(candidates([(0, 1), (1, 2)]))
    assert [(time.target, time.source) for time in execution.timings.pairs] == [(1, 3), (3, 8)]
