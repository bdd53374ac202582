"""The journal of a survey: what is in it stays, and what is no journal is told."""

import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial.transform import RigidTransform

from kernels.errors import InputError
from slam.execute.attempt import Attempt, to_text
from slam.execute.journal import Journal
from slam.execute.scan_key import KeyedScan, content_key, keyed
from slam.execute.worker import Done, Signed
from spectral.scan import PosePrior, Scan
from tests.samples.relative_priors import knowing
from tests.samples.surveys import registration

POINTS = np.random.default_rng(2).normal(size=(30, 3)).astype(np.float32)
A = keyed(Scan(POINTS, name="a"))
B = keyed(Scan(POINTS[::2], name="b"))
DONE = Done(to_text(Attempt(registration(RigidTransform.from_translation([0.1, 0.2, 0.7]), 0.3 * np.eye(6)))), 1.25)
FAILED = Done(to_text(Attempt(None, "b: too flat")), 0.5)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.sqlite"


def named(scan: KeyedScan, name: str) -> KeyedScan:
    return keyed(replace(scan.scan, name=name))


class TestKeys:
    @pytest.mark.parametrize("change", [{"name": "other"}, {"stamp": 7.0}, {"points": POINTS.copy(order="F")}])
    def test_names_stamps_and_layout_decide_nothing(self, change: dict) -> None:
        assert content_key(replace(A.scan, **change)) == A.key

    def test_points_strengths_and_priors_decide(self) -> None:
        T = RigidTransform.from_translation([1, 2, 3])
        known = PosePrior(T, knowing(slice(2), slice(2, 3)))
        changed = POINTS.copy()
        changed[3, 1] = np.nextafter(changed[3, 1], np.float32(9))
        scans = [
            A.scan,
            Scan(changed),
            Scan(POINTS[::-1]),
            Scan(POINTS, np.ones(30, np.float32)),
            Scan(POINTS, np.zeros(30, np.float32)),
            Scan(POINTS, prior=known),
            Scan(POINTS, prior=PosePrior(T, knowing(slice(2)))),
            Scan(POINTS, prior=PosePrior(RigidTransform.identity(), known.sigmas)),
        ]
        assert len({content_key(scan) for scan in scans}) == len(scans)


class TestKeeping:
    def test_a_pair_comes_back_in_another_run(self, path: Path) -> None:
        with Journal(path, "m") as journal:
            assert journal.pair(A, B) is None
            journal.add_pairs([(A, B)], [DONE])
        with Journal(path, "m") as journal:
            found = journal.pair(named(A, "x"), named(B, "y"))
            assert found is not None
            assert (to_text(found.attempt), found.seconds, journal.count()) == (DONE.attempt, 1.25, 1)
            assert journal.pair(B, A) is None
        with Journal(path, "another method") as journal:
            assert journal.pair(A, B) is None

    def test_a_failure_is_of_the_names_that_it_tells(self, path: Path) -> None:
        with Journal(path, "m") as journal:
            journal.add_pairs([(A, B)], [FAILED])
            found = journal.pair(A, B)
            assert found is not None
            assert found.attempt == Attempt(None, "b: too flat")
            assert journal.pair(A, named(B, "c")) is None

    @pytest.mark.parametrize("signature", [None, np.array([0.1, np.nan, -0.0, 3e38], np.float32)])
    def test_a_signature_comes_back(self, path: Path, signature: np.ndarray | None) -> None:
        with Journal(path, "m") as journal:
            assert journal.signature(A) is None
            journal.add_scans([A], [Signed(signature, 0.5)])
        with Journal(path, "m") as journal:
            found = journal.signature(A)
            assert found is not None
            assert found.seconds == 0.5
            if signature is None:
                assert found.signature is None
            else:
                assert found.signature is not None
                assert found.signature.dtype == np.float32
                assert_array_equal(found.signature.view(np.uint32), signature.view(np.uint32))

    def test_it_counts_how_often_a_pair_was_computed(self, path: Path) -> None:
        with Journal(path, "m") as journal:
            journal.add_pairs([(A, B), (B, A)], [FAILED, DONE])
            journal.add_pairs([(A, B)], [DONE])
        assert sorted(sqlite3.connect(path).execute("SELECT source, computed FROM pair")) == [("a", 1), ("b", 2)]

    def test_pairs_that_are_added_together_are_kept_all_or_none(self, path: Path) -> None:
        with Journal(path, "m") as journal:
            with pytest.raises(InputError, match="NOT NULL"):
                journal.add_pairs([(A, B), (B, A)], [DONE, replace(DONE, seconds=None)])  # pyright: ignore[reportArgumentType]
            assert journal.count() == 0
            journal.add_pairs([(A, B)], [DONE])

    def test_fresh_forgets(self, path: Path) -> None:
        with Journal(path, "m") as journal:
            journal.add_pairs([(A, B)], [DONE])
        with Journal(path, "m", fresh=True) as journal:
            assert journal.pair(A, B) is None

    def test_any_name_will_do(self, path: Path) -> None:
        scan = named(A, "3 \udcff\n深")
        with Journal(path, "m") as journal:
            journal.add_pairs([(scan, B)], [FAILED])
            assert journal.pair(scan, B) is not None


def other_program(path: Path) -> None:
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE pair (key TEXT)")
    database.close()


def overwritten(path: Path) -> None:
    """The middle of a journal with many rows."""
    with Journal(path, "m") as journal:
        for k in range(40):
            journal.add_pairs([(keyed(Scan(POINTS[k % 30 : k % 30 + 1], name=str(k))), B)], [DONE])
    content = bytearray(path.read_bytes())
    content[4096:12288] = b"\x99" * 8192
    path.write_bytes(content)


class TestOtherFiles:
    @pytest.mark.parametrize(
        "make",
        [other_program, overwritten, lambda path: path.write_text("my notes, " * 99)],
        ids=["db", "torn", "text"],
    )
    @pytest.mark.parametrize("fresh", [False, True])
    def test_what_is_no_journal_is_left_as_it_is(self, path: Path, make: Callable[[Path], object], fresh: bool) -> None:
        make(path)
        before = path.read_bytes()
        with pytest.raises(InputError, match=r"no journal of sonarmap, or it is damaged .* delete it"):
            Journal(path, "m", fresh)
        assert path.read_bytes() == before

    def test_a_row_that_is_no_attempt_is_told(self, path: Path) -> None:
        with Journal(path, "m") as journal:
            journal.add_pairs([(A, B)], [Done('{"registration": 7}', 1.0)])
            with pytest.raises(InputError, match="damaged"):
                journal.pair(A, B)

    def test_another_version_is_told_and_can_be_forgotten(self, path: Path) -> None:
        Journal(path, "m").close()
        with sqlite3.connect(path) as database:
            database.execute("PRAGMA user_version = 99")
        database.close()
        with pytest.raises(InputError, match="--fresh"):
            Journal(path, "m")
        with Journal(path, "m", fresh=True) as journal:
            assert journal.count() == 0

    def test_one_run_at_a_time(self, path: Path) -> None:
        with Journal(path, "m") as journal:
            journal.add_pairs([(A, B)], [DONE])
            for fresh in (False, True):
                with pytest.raises(InputError, match=r"in use: another run .* another output folder"):
                    Journal(path, "m", fresh)
            assert journal.pair(A, B) is not None
        Journal(path, "m").close()

    def test_a_folder_that_is_not_there_is_told(self, path: Path) -> None:
        with pytest.raises(InputError, match=r"cannot write .*journal.sqlite"):
            Journal(path / "below" / "journal.sqlite", "m")
