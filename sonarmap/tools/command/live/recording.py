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
_LOG = "recorder.log"
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
        self._folder, self._options = (out / FOLDER).resolve(), list(options)
        self._begun: list[float] = []
        self._process: subprocess.Popen[bytes] | None = None
        self._read = 0
        self._elsewhere = ""  # options of one that was taken over, if they are others
        self._id = self._left_at_work()
        if self._id is None:
            self._begin()
        elif (own := _options_of(self._id, self._folder)) != self._options:
            self._elsewhere = " ".join(own or []) or "its defaults"

    def look(self) -> Iterator[str]:
        """What it says, a line each; it is begun again where it was killed. Raises InputError: it cannot record."""
        code = self._exit_code()
        if self._elsewhere:
            yield f"the recording of an earlier run goes on, listening by {self._elsewhere}; to change that, end it"
            self._elsewhere = ""
        yield from self._lines()
        if code is None:
            return
        self._begun = [begun for begun in self._begun if time.monotonic() - begun < _WITHIN]
        if code in (0, 2, 3):
            raise InputError("the recording has ended; the map goes on with what came until then")
        if len(self._begun) >= _MOST_BEGUN:
            yield f"the recording was killed {_MOST_BEGUN} times within a minute, and begins again when that is over"
            return
        yield "the recording was killed, and begins again in another file; what came meanwhile is lost"
        self._begin()

    def end(self) -> None:
        """End the recording, which gives its file its name. Where one was killed before anything came no file stays."""
        if self._id is not None and self._exit_code() is None:
            with suppress(ProcessLookupError):
                os.kill(self._id, signal.SIGTERM)  # a shell may have it ignore interrupts
            until = time.monotonic() + _PATIENCE
            while self._exit_code() is None and time.monotonic() < until:
                time.sleep(0.05)
        if self._exit_code() is not None:
            for path in self._folder.glob("*.part*.sonar"):
                if path.stat().st_size == 0:
                    path.unlink()

    def _begin(self) -> None:
        """Raises InputError: the system does not allow it."""
        number = 1 + max((int(path.name[:3]) for path in self._folder.glob("[0-9][0-9][0-9].*")), default=0)
        file = self._folder / f"{number:03d}.sonar"
        command = [sys.executable, "-m", "sonarmap", "record", "--json", "-o", str(file), *self._options]
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with (self._folder / _LOG).open("ab") as log:
                self._read = log.tell()
                self._process = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log, start_new_session=True
                )
        except OSError as error:
            raise InputError(
                f"cannot record to {self._folder}: {error.strerror or error}. Choose another output folder, or make "
                "room and check its permissions"
            ) from error
        self._id = self._process.pid
        self._begun.append(time.monotonic())

    def _left_at_work(self) -> int | None:
        """The number of a process that records to the folder; None where there is none."""
        numbers = (int(process.name) for process in Path("/proc").glob("[0-9]*"))
        return next((number for number in numbers if _options_of(number, self._folder) is not None), None)

    def _exit_code(self) -> int | None:
        """None while it is at work; -1 of one that was taken over and has gone."""
        if self._process is not None:
            return self._process.poll()
        return -1 if self._id is None or _options_of(self._id, self._folder) is None else None

    def _lines(self) -> Iterator[str]:
        with suppress(OSError), (self._folder / _LOG).open("rb") as log:
            log.seek(self._read)
            text = log.read()
            whole = text[: text.rfind(b"\n") + 1]
            self._read += len(whole)
            yield from whole.decode("utf-8", "replace").splitlines()


def _options_of(number: int, folder: Path) -> list[str] | None:
    """Where a process that records to a folder listens; None of another process, or one that has gone."""
    try:
        words = Path(f"/proc/{number}/cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return None
    file = next((k for k, word in enumerate(words) if word.startswith(f"{folder}{os.sep}")), None)
    return None if file is None or "record" not in words else words[file + 1 : -1]
