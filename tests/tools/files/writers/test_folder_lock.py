"""Who may use a folder now: one that writes, or several that read."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.folder_lock import locked
from tests.samples.command_line import ROOT

HOLD = """
import sys
from pathlib import Path
from sonarmap.tools.files.writers.folder_lock import locked
with locked(Path(sys.argv[1]), writing=True):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.mark.parametrize(("held", "asked", "free"), [(0, 0, True), (0, 1, False), (1, 0, False), (1, 1, False)])
def test_readers_share_and_a_writer_is_alone(tmp_path: Path, held: int, asked: int, free: bool) -> None:
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


def test_another_process_holds_it_until_it_ends_however_it_ends(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(InputError, match="is in use"), locked(tmp_path, writing=False):
            pass
        os.kill(other.pid, signal.SIGKILL)
    with locked(tmp_path, writing=True):
        pass


@pytest.mark.parametrize("kind", ["missing", "file", "fifo"])
def test_what_is_no_folder_is_not_locked_and_not_waited_for(tmp_path: Path, kind: str) -> None:
    path = tmp_path / kind
    if kind == "file":
        path.touch()
    if kind == "fifo":
        os.mkfifo(path)
    with locked(path, writing=True), locked(path, writing=True):
        pass


def test_a_file_system_without_locks_is_used_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none_here(*_: object) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr("fcntl.flock", none_here)
    with locked(tmp_path, writing=True), locked(tmp_path, writing=True):
        pass
