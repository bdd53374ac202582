"""`--log-file`: what a command says, with times, at the end of a file."""

import io
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import TextIO

from sonarmap.kernels.errors import InputError

_FIRST_LINE = re.compile(r"\S+Z sonarmap \S+: sonarmap")  # that `logged` writes
_COLORS = re.compile(r"\x1b\[[0-9;]*m")
_open: list["_Log"] = []  # of this program, whatever thread speaks; the last is written to


class _Log:
    """A file that lines are added to. A disk that is full ends the log, not the work that it is about."""

    def __init__(self, path: Path) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._refuse_other_files(path)
            self._file: TextIO | None = path.open("a", encoding="utf-8", errors="backslashreplace", buffering=1)
        except OSError as error:
            raise InputError(
                f"cannot write the log {path}: {error.strerror or error}. Choose another file for --log-file"
            ) from error

    def _refuse_other_files(self, path: Path) -> None:
        """Whoever gives a scan for --log-file shall not find lines of text at its end."""
        if path.is_file() and path.stat().st_size:
            with path.open(encoding="utf-8", errors="replace") as file:
                if not _FIRST_LINE.match(file.readline(1000)):
                    raise InputError(
                        f"--log-file {path}: this file is there, and is not a log of sonarmap; choose another"
                    )

    def add(self, text: str) -> None:
        """Add lines, each with the time."""
        if self._file is None:
            return
        now = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
        try:
            self._file.writelines(f"{now} {line}\n" for line in text.splitlines())
        except OSError:
            self.close()

    def close(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            with suppress(OSError):  # the last lines did not fit
                file.close()


class _Results(io.TextIOBase):
    """What is printed on stdout, line by line into the log too; on stdout itself only where it is `shown`."""

    def __init__(self, stdout: TextIO, shown: bool, copied: bool) -> None:
        self._stdout, self._shown, self._copied, self._line = stdout, shown, copied, ""

    @property
    def encoding(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride] - of a stream that cannot be set
        return getattr(self._stdout, "encoding", None) or "utf-8"

    def writable(self) -> bool:
        return True

    def isatty(self) -> bool:
        return self._stdout.isatty()

    def fileno(self) -> int:
        return self._stdout.fileno()

    def write(self, text: str) -> int:
        if self._copied:
            *lines, self._line = (self._line + text).split("\n")
            for line in lines:
                log(_COLORS.sub("", line).rstrip())
        return self._stdout.write(text) if self._shown else len(text)

    def flush(self) -> None:
        if self._shown:
            self._stdout.flush()


@contextmanager
def logged(path: Path | None, first: str) -> Iterator[None]:
    """Add what is said within the block to a file, which and whose folder is made if missing; None for no log. `first`
    is its first line: version and command.

    Raises InputError: the file cannot be written, or is no log.
    """
    if path is None:
        yield
        return
    _open.append(_Log(path))
    try:
        log(first)
        yield
    finally:
        _open.pop().close()


@contextmanager
def results_to(shown: bool, copied: bool) -> Iterator[None]:
    """Within the block what is printed on stdout is `shown` or not, and `copied` to the log or not."""
    if shown and not (copied and _open):
        yield
        return
    with redirect_stdout(_Results(sys.stdout, shown, copied)):
        yield


def log(text: str) -> None:
    """Add lines to the log, if there is one."""
    if _open:
        _open[-1].add(text)
