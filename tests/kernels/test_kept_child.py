"""Clouds that another process reads: what it says is what is read here, and its end is a refusal of one file."""

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels import kept_child as module
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.kept_child import run_apart
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.scans import read_survey
from tests.samples.cloud_files import POINTS, las
from tests.samples.places import ROOT
from tests.samples.refusals import refuses


def whole(content: bytes) -> list[Cloud]:
    """Stamped with the number of the process."""
    points = np.frombuffer(content, "<f4").reshape(-1, 3)
    return [Cloud(points, points[:, 0], os.getpid(), ("a note",), points * 2), Cloud(points[:0], times=points[:0, 0])]


def refuse(content: bytes) -> list[Cloud]:
    raise InputError(f"{len(content)} bytes are not to its taste")


def crash(_: bytes) -> list[Cloud]:
    ctypes.string_at(0)
    return []


def leave(_: bytes) -> list[Cloud]:
    os._exit(7)


# pyrefly: ignore[unexpected-never]
def loop(_: bytes) -> list[Cloud]:
    while True:
        pass


def gorge(_: bytes) -> list[Cloud]:
    return [Cloud(np.ones((1 << 30, 3)))]


def process() -> float | None:
    """That reads now."""
    return run_apart(whole, POINTS.tobytes())[0].stamp


def test_clouds_from_the_other_process_equal_those_read_here() -> None:
    here, there = (read(POINTS.astype("<f4").tobytes()) for read in (whole, lambda content: run_apart(whole, content)))
    for cloud, other in zip(here, there, strict=True):
        for name in ("points", "strength", "viewpoints", "times"):
            np.testing.assert_array_equal(getattr(cloud, name), getattr(other, name))
        assert cloud.notes == other.notes
    assert there[0].stamp not in (os.getpid(), None)
    assert there[1].stamp is None


@pytest.mark.slow
def test_the_process_is_reused_until_it_ends() -> None:
    first = process()
    refuses("3 bytes are not to its taste", run_apart, refuse, b"abc")
    assert process() == first
    refuses("its library ended with SIGSEGV: the file is cut or damaged; copy it again", run_apart, crash, b"")
    second = process()
    assert second != first
    refuses("ended with exit code 7", run_apart, leave, bytes(1 << 24))
    assert process() != second


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not bound a process")
def test_time_and_memory_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    refuses("it takes more memory than", run_apart, gorge, b"")
    first = process()
    with monkeypatch.context() as patch:
        patch.setattr(module, "_SECONDS", 1)
        refuses("ended with SIGXCPU", run_apart, loop, b"")
    assert process() != first


def test_an_interrupted_answer_is_not_given_to_the_next_file(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: object) -> bytes:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(module.pickle, "load", interrupted)
        with pytest.raises(KeyboardInterrupt):
            process()
    refuses("2 bytes are not", run_apart, refuse, b"ab")


def hostile() -> bytes:
    """50 bytes in the middle of a LAZ file set to 255, which lazrs 0.8.2 does not survive."""
    rng = np.random.default_rng(1)
    table = np.hstack([rng.normal(0, 5, (50, 3)), rng.integers(0, 60_000, (50, 1))])
    content = bytearray(las(table, form=3, version="1.2", gps=np.arange(50) / 8))
    middle = len(content) // 2
    content[middle - 25 : middle + 25] = b"\xff" * 50
    return bytes(content)


def test_a_laz_file_that_crashes_its_library_leaves_a_gap(tmp_path: Path) -> None:
    for name, content in (("a", las()), ("b", hostile()), ("c", las())):
        (tmp_path / f"{name}.laz").write_bytes(content)
    read = read_survey([tmp_path])
    assert [scan.name for scan in read.scans] == ["a", "c"]
    assert [unread.where for unread in read.unread] == [str(tmp_path / "b.laz")]
    assert "the file is cut or damaged; copy it again" in read.unread[0].reason


@pytest.mark.slow
def test_a_script_needs_no_guard_and_leaves_no_process(tmp_path: Path) -> None:
    (tmp_path / "a.laz").write_bytes(las())
    (tmp_path / "script.py").write_text(
        "import sonarmap\nprint(len(sonarmap.read_scans('a.laz')[0].points))\n"
        "from sonarmap.kernels.kept_child import _reader\nprint(_reader[1].pid)\n"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    ended = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    points, kept = ended.stdout.split()
    assert (points, ended.stderr) == ("5", "")
    with pytest.raises(ProcessLookupError):
        os.kill(int(kept), 0)
