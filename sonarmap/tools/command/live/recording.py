# pyright: strict
"""The process that records: it knows nothing of the others, and goes on whatever becomes of them."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from sonarmap.kernels.errors import InputError

FOLDER = "recording"  # within the map's folder
_LOG, _PROCESS = "recorder.log", "recorder.pid"
_MOST_BEGUN, _WITHIN = 5, 60.0  # so often it is begun again within so long [s]
_PATIENCE = 10.0  # until it has ended [s]


class RecordingProcess:
    """`sonarmap record` beside this process, into OUT/recording/001.sonar, 002.sonar and so on; one that an earlier run
    has left at work is taken over.

    Args:
        out: the map's folder.
        options: of `sonarmap record`, which say where packets come in.
    """

    def __init__(self, out: Path, options: Sequence[str]) -> None:
        self._folder, self._options = out / FOLDER, list(options)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._begun: list[float] = []
        self._process: subprocess.Popen[bytes] | None = None
        self._read = 0
        self._id = self._left_at_work()
        if self._id is None:
            self._begin()

    def look(self) -> Iterator[str]:
        """What it says, a line each; it is begun again where it was killed. Raises InputError: it cannot record."""
        yield from self._lines()
        code = self._exit_code()
        if code is None:
            return
        self._begun = [begun for begun in self._begun if time.monotonic() - begun < _WITHIN]
        if code in (0, 2) or len(self._begun) >= _MOST_BEGUN:
            raise InputError("the recording has ended; the map goes on with what came until then")
        yield "the recording was killed, and begins again in another file; what came meanwhile is lost"
        self._begin()

    def end(self) -> None:
        """End the recording, which gives its file its name."""
        if self._id is None or self._exit_code() is not None:
            return
        with suppress(ProcessLookupError):
            os.kill(self._id, signal.SIGTERM)  # a shell may have it ignore interrupts
        until = time.monotonic() + _PATIENCE
        while self._exit_code() is None and time.monotonic() < until:
            time.sleep(0.05)
        (self._folder / _PROCESS).unlink(missing_ok=True)

    def _begin(self) -> None:
        number = 1 + max((int(path.name[:3]) for path in self._folder.glob("[0-9][0-9][0-9].*")), default=0)
        file = self._folder / f"{number:03d}.sonar"
        command = [sys.executable, "-m", "sonarmap", "record", "--json", "-o", str(file), *self._options]
        with (self._folder / _LOG).open("ab") as log:
            self._read = log.tell()
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log, start_new_session=True
            )
        self._id = self._process.pid
        self._begun.append(time.monotonic())
        (self._folder / _PROCESS).write_text(str(self._id))

    def _left_at_work(self) -> int | None:
        """The number of the process that an earlier run has left; None where there is none."""
        with suppress(OSError, ValueError):
            number = int((self._folder / _PROCESS).read_text())
            if str(self._folder) in Path(f"/proc/{number}/cmdline").read_bytes().decode(errors="replace"):
                return number
        return None

    def _exit_code(self) -> int | None:
        """None while it is at work; -1 of one that was taken over and has gone."""
        if self._process is not None:
            return self._process.poll()
        return None if self._left_at_work() else -1

    def _lines(self) -> Iterator[str]:
        with suppress(OSError), (self._folder / _LOG).open("rb") as log:
            log.seek(self._read)
            text = log.read()
            whole = text[: text.rfind(b"\n") + 1]
            self._read += len(whole)
            yield from whole.decode("utf-8", "replace").splitlines()
