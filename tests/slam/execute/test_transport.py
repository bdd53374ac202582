"""Scans on their way to other processes of this machine: each is read when it is needed, written once, and removed."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial.transform import RigidTransform

from kernels.errors import InputError
from slam.execute.executor import processes
from slam.execute.runner import Execution, PairRunner
from slam.execute.scan_key import scan_key
from slam.execute.transport import spooled
from slam.pair import Pair
from spectral.scan import PosePrior, Scan
from tests.samples.clusters.survey_worker import worker_spec
from tests.samples.surveys import ring_poses, scans_of

COUNT = 8
SCANS = scans_of(ring_poses(COUNT))
PAIRS = [Pair(i, i + step, "loop") for step in (1, 2, 3) for i in range(COUNT - step)]


class Counted(Sequence[Scan]):
    """Scans that are read from somewhere, every time."""

    def __init__(self) -> None:
        self.read = [0] * COUNT

    def __len__(self) -> int:
        return COUNT

    def __getitem__(self, k: int) -> Scan:  # pyright: ignore[reportIncompatibleMethodOverride]
        self.read[k] += 1
        return SCANS[k]

    def __iter__(self) -> Iterator[Scan]:
        return (self[k] for k in range(COUNT))


def test_a_scan_is_read_for_its_key_and_for_its_file_and_never_again(tmp_path: Path) -> None:
    scans, folder = Counted(), tmp_path / "spool"
    with processes(2, spool=folder) as executor:
        runner = PairRunner(Execution(worker_spec(COUNT, tmp_path / "notes"), executor), scans, 0, None)
        assert scans.read == [1] * COUNT
        assert not folder.exists()
        runner.register(PAIRS[:2])
        assert scans.read == [2] * 3 + [1] * (COUNT - 3)
        runner.register(PAIRS)
        runner.signatures()
        assert scans.read == [2] * COUNT
        assert len(list(folder.iterdir())) == COUNT
        assert folder.stat().st_mode & 0o077 == 0
    assert not folder.exists()


def test_a_stopped_run_leaves_nothing(tmp_path: Path) -> None:
    def run() -> None:
        with processes(2, spool=tmp_path / "spool") as executor:
            PairRunner(Execution(worker_spec(COUNT, tmp_path / "notes"), executor), SCANS, 0, None).register(PAIRS)
            assert (tmp_path / "spool").exists()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run()
    assert [path.name for path in tmp_path.iterdir()] == ["notes"]


def test_a_scan_comes_back_as_it_was(tmp_path: Path) -> None:
    points = np.random.default_rng(1).normal(size=(9, 3)).astype(np.float32)
    prior = PosePrior(RigidTransform.from_translation([1, 2, 3]), np.array([1, 1, np.inf, np.inf, np.inf, 2.0]))
    scan = Scan(points, points[:, 0] ** 2, 7.5, prior, "a name", -points)
    with spooled(None) as spool:
        source = spool.source(scan_key(scan), partial(iter([scan]).__next__))
        back = source.load()
        folder = source.path.parent
    assert not folder.exists()
    for name in ("points", "strength", "viewpoints"):
        assert_array_equal(getattr(back, name), getattr(scan, name))
    assert (back.name, back.stamp) == (scan.name, scan.stamp)
    assert scan_key(back) == scan_key(scan)


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with (
        spooled(tmp_path / "file" / "spool") as spool,
        pytest.raises(InputError, match=r"cannot write scan3 .*`workers`"),
    ):
        spool.source(scan_key(SCANS[3]), lambda: SCANS[3])
