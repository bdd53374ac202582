"""The recording process: it is independent of the others, and only the user ends it."""

import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event

from sonarmap.kernels.errors import InputError

FOLDER = "recording"  # within the map's folder
_LOG = "recorder.log"
_TICK = 0.2  # interval of checks [s]
_MOST_SAID = 64  # messages that wait to be shown
_PATIENCE = 10.0  # for the process to end [s]


class RecordingProcess:
    """`sonarmap record` in a process of its own, to OUT/recording/001.sonar, 002.sonar and so on. A recording that an
    earlier run has left running is taken over. `options` of `sonarmap record` say where packets are received."""

    def __init__(self, out: Path, options: Sequence[str]) -> None:
        self._folder, self._options = (out / FOLDER).resolve(), list(options)
        self.said = deque[str](maxlen=_MOST_SAID)  # messages to show
        self._again = Again()
        self._due: float | None = None  # time of the next start [s]; None while it runs
        self._process: subprocess.Popen[bytes] | None = None
        self._read = 0
        self._id = recorder_of(out)
        if self._id is None:
            self._begin()
        elif (running := _options_of(self._id, self._folder)) != self._options:
            words = " ".join(running or []) or "its default source"
            self.said.append(f"the recording of an earlier run goes on with {words}; end it to change that")

    def keep_on(self, stop: Event) -> None:
        """Restart the recording whenever it ends, until `stop` is set; then end it."""
        while not stop.wait(_TICK):
            with suppress(Exception):
                self.look()
        self.end()

    def look(self) -> None:
        """Collect its messages, and restart it if that is due."""
        code, now = self._exit_code(), time.monotonic()
        self.said.extend(self._lines())
        if code is None:
            return
        if self._due is None:
            pause = self._again.pause()
            self._due = now + pause
            ended = "was killed" if code < 0 else "has ended"
            self.said.append(f"the recording {ended}, and begins again in another file{in_words(pause)}")
        if now >= self._due:
            try:
                self._begin()
            except InputError as error:
                self._due = now + self._again.pause()
                self.said.append(str(error))

    def end(self) -> None:
        """End the recording, which then renames its file, and delete empty files of recordings that were killed."""
        if self._id is not None and self._exit_code() is None:
            with suppress(ProcessLookupError):
                os.kill(self._id, signal.SIGTERM)  # not SIGINT, which it ignores if a shell says so
            until = time.monotonic() + _PATIENCE
            while self._exit_code() is None and time.monotonic() < until:
                time.sleep(0.05)
        if self._exit_code() is not None:
            for path in self._folder.glob("*.part*.sonar"):
                if path.stat().st_size == 0:
                    path.unlink()

    def _begin(self) -> None:
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
                f"cannot record to {self._folder}: {error.strerror or error}; choose another folder, or make room"
            ) from error
        self._id, self._due = self._process.pid, None
        self._again.begins()

    def _exit_code(self) -> int | None:
        """None while it runs; -1 for a process that was taken over and has ended."""
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


def recorder_of(out: Path) -> int | None:
    """Id of the process that records to a map's folder; None if there is none."""
    pids, folder = (int(process.name) for process in Path("/proc").glob("[0-9]*")), (out / FOLDER).resolve()
    return next((pid for pid in pids if _options_of(pid, folder) is not None), None)


def _options_of(pid: int, folder: Path) -> list[str] | None:
    """Options of the process that records to a folder; None if this process does not, or has ended."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return None
    file = next((k for k, word in enumerate(words) if word.startswith(f"{folder}{os.sep}")), None)
    return None if file is None or "record" not in words else words[file + 1 : -1]


_STEADY = 60.0  # running time after which failures are counted from 1 again [s]
_LONGEST = 30.0  # longest pause [s]


@dataclass(slots=True)
class Again:
    """Pauses before restarts: 0, 1, 3, 7, 15 and then 30 s."""

    failures: int = 0  # in a row
    _begun: float = field(default_factory=time.monotonic)

    def begins(self) -> None:
        """Note a start."""
        self._begun = time.monotonic()

    def pause(self) -> float:
        """Note a failure; the pause before the next start [s]."""
        self.failures = 1 + self.failures * (time.monotonic() - self._begun < _STEADY)
        return min(_LONGEST, 2.0 ** (self.failures - 1) - 1)


def in_words(pause: float) -> str:
    """A pause in words, such as " in 7 s"; "" for none."""
    return f" in {pause:.0f} s" if pause else ""
