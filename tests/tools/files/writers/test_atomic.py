"""Sets of files that appear together, and who may use a folder: one that writes, or several that read."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.atomic import all_or_none, atomic_path, clear_leftovers, locked
from tests.samples.places import ROOT


def put(path: Path, text: str) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(text)


def test_an_inner_block_writes_its_files_with_the_outer_one(tmp_path: Path) -> None:
    with all_or_none() as written:
        put(tmp_path / "a", "1")
        with all_or_none():
            put(tmp_path / "b", "2")
        assert [path.name for _, path in written] == ["a", "b"]
        assert [temporary.read_text() for temporary, _ in written] == ["1", "2"]
        assert not (tmp_path / "a").exists()
        assert not (tmp_path / "b").exists()
    assert {path.name for path in tmp_path.iterdir()} == {"a", "b"}


def test_files_of_an_inner_block_are_removed_if_the_outer_one_fails(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), all_or_none():  # noqa: PT012
        with all_or_none():
            put(tmp_path / "a", "1")
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_files_have_the_permissions_of_any_new_file_and_the_process_keeps_its_mask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mask: int
) -> None:
    """A moment without a mask is one in which another thread's files are everybody's."""
    set_mask, before = os.umask, os.umask(mask)
    try:
        monkeypatch.setattr(os, "umask", lambda _: pytest.fail("the mask is all threads'"))
        put(tmp_path / "a", "1")
        assert (tmp_path / "a").stat().st_mode & 0o777 == 0o666 & ~mask
    finally:
        set_mask(before)


def test_leftovers_are_removed_but_not_the_target_of_a_link(tmp_path: Path) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    (out / ".sonarmap.scans.x1").mkdir(parents=True)
    (out / ".sonarmap.scans.x1" / "0.npz").write_text("")
    (out / ".sonarmap.1.ply").write_text("half")
    elsewhere.mkdir()
    put(elsewhere / "mine", "1")
    (out / ".sonarmap.scans").symlink_to(elsewhere)
    clear_leftovers(out)
    assert not list(out.iterdir())
    assert (elsewhere / "mine").read_text() == "1"


@pytest.mark.parametrize("writing", [False, True])
def test_only_a_writer_that_is_alone_removes_leftovers_of_killed_runs(tmp_path: Path, writing: bool) -> None:
    (tmp_path / ".sonarmap.1.laz").write_text("half")
    with locked(tmp_path, writing=False), pytest.raises(InputError, match="is in use"), locked(tmp_path, writing=True):
        pass
    assert list(tmp_path.iterdir())  # another run reads, and may write beside
    with locked(tmp_path, writing=writing):
        assert bool(list(tmp_path.iterdir())) != writing


HOLD = """
import sys
from pathlib import Path
from sonarmap.tools.files.writers.atomic import locked
with locked(Path(sys.argv[1]), writing=True):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.mark.parametrize(("held", "asked", "free"), [(0, 0, True), (0, 1, False), (1, 0, False), (1, 1, False)])
def test_readers_share_a_folder_and_a_writer_locks_it(tmp_path: Path, held: int, asked: int, free: bool) -> None:
    def refusal() -> str:
        try:
            with locked(tmp_path, writing=bool(asked)):
                return ""
        except InputError as error:
            return str(error)

    with locked(tmp_path, writing=bool(held)):
        words = refusal()
    assert (words == "") == free
    if words:
        assert words.startswith(f"{tmp_path} is in use: another run of sonarmap is writing to it")
        assert "Wait until it has ended" in words
    assert refusal() == ""
    assert not list(tmp_path.iterdir())


def test_a_lock_ends_with_its_process_even_if_that_is_killed(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(InputError, match="is in use"), locked(tmp_path, writing=False):
            pass
        os.kill(other.pid, signal.SIGKILL)
    with locked(tmp_path, writing=True):
        pass


def test_files_pipes_and_missing_folders_are_not_locked(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    os.mkfifo(tmp_path / "fifo")
    for path in (tmp_path / "missing", tmp_path / "file", tmp_path / "fifo"):
        with locked(path, writing=True), locked(path, writing=True):
            pass


def test_a_file_system_without_locks_is_used_without_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none_here(*_: object) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr("fcntl.flock", none_here)
    with locked(tmp_path, writing=True), locked(tmp_path, writing=True):
        pass
