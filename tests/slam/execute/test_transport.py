"""Scans on their way to other processes, each read when needed, written once and removed; and keys of scans."""

import io
import os
import pickle
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import DeviceError, InputError
from sonarmap.slam.execute.executor import processes
from sonarmap.slam.execute.runner import Execution, PairRunner
from sonarmap.slam.execute.transport import content_key, scan_key, spooled
from sonarmap.slam.pair import Candidate
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.relative_priors import knowing
from tests.samples.survey_worker import worker_spec
from tests.samples.surveys import ring_poses, scans_of

COUNT = 8
SCANS = scans_of(ring_poses(COUNT))
PAIRS = [Candidate(i, i + step, "loop") for step in (1, 2, 3) for i in range(COUNT - step)]


def test_a_stopped_run_leaves_no_file(tmp_path: Path) -> None:
    def run() -> None:
        with processes(1, spool=tmp_path / "spool") as executor:
            PairRunner(Execution(worker_spec(COUNT, tmp_path / "notes"), executor), SCANS, 0, None).register(PAIRS[:4])
            assert len(list(tmp_path.glob("spool*"))) == 1
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run()
    assert [path.name for path in tmp_path.iterdir()] == ["notes"]


def test_a_scan_comes_back_as_it_was(tmp_path: Path) -> None:
    points = np.random.default_rng(1).normal(size=(9, 3)).astype(np.float32)
    T_world_sensor = RigidTransform.from_exp_coords([0.1, 0.7, -0.3, 1, 2, 3])
    prior = PosePrior(T_world_sensor, np.array([1, 1, np.inf, np.inf, np.inf, 2.0]))
    name, times = "a name\udce9 of \N{GREEK SMALL LETTER ALPHA}", points[:, 1].copy()
    scan = Scan(points, points[:, 0] ** 2, 7.5, prior, name, -points, times)
    with spooled(None) as spool:
        source = spool.source(scan_key(scan), partial(iter([scan]).__next__))
        back = source.load()
        folder = source.path.parent
    assert not folder.exists()
    for name in ("points", "strength", "viewpoints", "times"):
        assert_array_equal(getattr(back, name), getattr(scan, name))
    assert (back.name, back.stamp) == (scan.name, scan.stamp)
    assert scan_key(back) == scan_key(scan)


class Harmful:
    """Makes a folder when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.mark),)


@pytest.mark.slow
def test_files_of_others_in_the_spool_are_neither_read_nor_written(tmp_path: Path) -> None:
    """Also pickles of an earlier version, whose names begin with the scan's number."""
    theirs = tmp_path / "elsewhere"
    theirs.mkdir(mode=0o777)
    (tmp_path / "spool").symlink_to(theirs)
    for k in range(COUNT):
        for suffix in ("scan", "npz"):
            (theirs / f"{k}.{suffix}").write_bytes(pickle.dumps(Harmful(tmp_path / "harmed")))
    before = {path.name: path.read_bytes() for path in theirs.iterdir()}
    with processes(2, spool=tmp_path / "spool") as executor:
        runner = PairRunner(Execution(worker_spec(COUNT, tmp_path / "notes"), executor), SCANS, 0, None)
        pairs = runner.register(PAIRS)
    assert [pair.scans for pair in pairs if pair.registration is None] == [p.scans for p in PAIRS if 2 in p.scans]
    assert {path.name: path.read_bytes() for path in theirs.iterdir()} == before
    assert not (tmp_path / "harmed").exists()


def bytes_of(**arrays: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.savez(file, allow_pickle=True, **arrays)
    return file.getvalue()


@pytest.mark.parametrize("kind", ["pickle", "pickled array", "cut", "gone"])
def test_a_changed_file_runs_no_code_and_is_refused(tmp_path: Path, kind: str) -> None:
    """It is a fault of the machine, not of the pair: nothing goes into the journal."""
    harmful = Harmful(tmp_path / "harmed")
    with spooled(tmp_path / "spool") as spool:
        source = spool.source(scan_key(SCANS[3]), lambda: SCANS[3])
        contents = {
            "pickle": pickle.dumps(harmful),
            "pickled array": bytes_of(points=np.array([harmful], dtype=object)),
            "cut": source.path.read_bytes()[:-300],
        }
        source.path.unlink()
        if kind in contents:
            source.path.write_bytes(contents[kind])
        with pytest.raises(DeviceError, match="was removed or changed"):
            source.load()
    assert not (tmp_path / "harmed").exists()


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    refused = pytest.raises(InputError, match=r"cannot write scan3 .*`workers`")
    with spooled(tmp_path / "file" / "spool") as spool, refused:
        spool.source(scan_key(SCANS[3]), lambda: SCANS[3])


POINTS = np.random.default_rng(2).normal(size=(30, 3)).astype(np.float32)
A = Scan(POINTS, name="a")


class TestKeys:
    @pytest.mark.parametrize("change", [{"name": "other"}, {"stamp": 7.0}, {"points": POINTS.copy(order="F")}])
    def test_names_stamps_and_layout_do_not_change_a_key(self, change: dict) -> None:
        assert content_key(replace(A, **change)) == content_key(A)

    def test_arrays_and_priors_change_a_key(self) -> None:
        T = RigidTransform.from_translation([1, 2, 3])
        known = PosePrior(T, knowing(slice(2), slice(2, 3)))
        changed = POINTS.copy()
        changed[3, 1] = np.nextafter(changed[3, 1], np.float32(9))
        scans = [
            A,
            Scan(changed),
            Scan(POINTS[::-1]),
            Scan(POINTS, np.ones(30, np.float32)),
            Scan(POINTS, np.zeros(30, np.float32)),
            Scan(POINTS, viewpoints=POINTS),
            Scan(POINTS, viewpoints=changed),
            Scan(POINTS, times=np.zeros(30, np.float32)),
            Scan(POINTS, times=np.ones(30, np.float32)),
            Scan(POINTS, prior=known),
            Scan(POINTS, prior=PosePrior(T, knowing(slice(2)))),
            Scan(POINTS, prior=PosePrior(RigidTransform.identity(), known.sigmas)),
        ]
        assert len({content_key(scan) for scan in scans}) == len(scans)


class Counted(Sequence[Scan]):
    """Scans that are read at every access, with counts."""

    def __init__(self) -> None:
        self.read = [0] * COUNT

    def __len__(self) -> int:
        return COUNT

    # pyrefly: ignore[bad-override]
    def __getitem__(self, k: int) -> Scan:
        self.read[k] += 1
        return SCANS[k]

    def __iter__(self) -> Iterator[Scan]:
        return (self[k] for k in range(COUNT))


@pytest.mark.slow
def test_a_scan_is_read_once_for_its_key_and_once_for_its_file(tmp_path: Path) -> None:
    scans = Counted()
    with processes(2, spool=tmp_path / "spool") as executor:
        runner = PairRunner(Execution(worker_spec(COUNT, tmp_path / "notes"), executor), scans, 0, None)
        assert scans.read == [1] * COUNT
        assert not list(tmp_path.glob("spool*"))
        runner.register(PAIRS[:2])
        assert scans.read == [2] * 3 + [1] * (COUNT - 3)
        runner.register(PAIRS)
        runner.signatures()
        assert scans.read == [2] * COUNT
        (folder,) = tmp_path.glob("spool*")
        assert len(list(folder.iterdir())) == COUNT
        assert folder.stat().st_mode & 0o077 == 0
    assert not folder.exists()
