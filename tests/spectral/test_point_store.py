"""Arrays on disk keep their values as long as they are referenced."""

import gc
import os
import tempfile
from pathlib import Path

import numpy as np
import pytest

from sonarmap.spectral import point_store
from sonarmap.spectral.point_store import PointStore
from sonarmap.tools.files.readers import scans
from sonarmap.tools.files.readers.scans import read_survey
from sonarmap.tools.files.writers.points import write_ply
from tests.samples.refusals import refuses


def test_arrays_come_back_as_they_were_in_memory_and_on_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(point_store, "_CHUNK", 4096)
    rng = np.random.default_rng(1)
    shapes = [(7, 3), (1,), (200, 3), (1000, 3), (5,), (33,), (2, 3)]
    given = [rng.normal(size=shape).astype(np.float32) for shape in shapes]
    store = PointStore(in_memory=100)
    kept = [store.keep(array) for array in given]
    assert kept[0] is given[0]
    assert not any(one is other for one, other in zip(kept[1:], given[1:], strict=True) if other.size > 1)
    del store
    gc.collect()
    for one, other in zip(kept, given, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    with pytest.raises(ValueError, match="read-only"):
        kept[-1][0] = 0


def test_no_file_remains_and_a_full_disk_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    kept = PointStore(0).keep(np.ones(10, np.float32))
    assert not list(tmp_path.iterdir())
    assert kept.sum() == 10

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    words = r"no room for the rest: No space left on device\. Make room there, or set"
    refuses(words, PointStore(0).keep, np.ones(10, np.float32))


def test_a_survey_is_read_the_same_from_memory_and_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    for k in range(5):
        strength = rng.random(60).astype(np.float32)
        write_ply(tmp_path / f"scan{k}.ply", rng.normal(size=(60, 3)), {"intensity": strength} if k % 2 else {})
    told: list[tuple[int, int, str]] = []
    in_memory = read_survey([tmp_path], progress=lambda *step: told.append(step))
    monkeypatch.setattr(scans, "PointStore", lambda: PointStore(700))
    on_disk = read_survey([tmp_path])
    assert told == [(k + 1, 5, f"scan{k}.ply") for k in range(5)]
    for one, other in zip(in_memory.scans, on_disk.scans, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        assert (one.strength is None) == (other.strength is None)
        assert one.strength is None or (one.strength == other.strength).all()
        assert (one.name, one.stamp) == (other.name, other.stamp)
