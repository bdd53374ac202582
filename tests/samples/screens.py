"""A program in a terminal of a given size, and its screen as a person sees it."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import sys
import termios
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.samples.places import ROOT

PATIENCE = 240.0  # s
_NOT_OURS = ("COLUMNS", "LINES", "NO_COLOR", "FORCE_COLOR", "CI", "TTY_COMPATIBLE", "TTY_INTERACTIVE")


@dataclass(frozen=True)
class Shown:
    """lines: of the last screen, without spaces at their ends and without empty lines at the end.
    scrolled: number of lines that have scrolled out at the top.
    moment: the lines of the screen when a line matched; none if none did.
    exit_code: of the program."""

    lines: list[str]
    scrolled: int
    moment: list[str]
    exit_code: int


def on_screen(
    program: str,
    *arguments: str | Path,
    columns: int = 80,
    rows: int = 24,
    when: str = "",
    folder: Path = ROOT,
) -> Shown:
    """Run a Python program with a terminal of these columns and rows as its stdin, stdout and stderr, in a folder.

    When a line of the screen first matches the pattern `when`, the screen is kept.
    """
    pyte = pytest.importorskip("pyte")
    screen = pyte.HistoryScreen(columns, rows, history=10_000)
    stream = pyte.ByteStream(screen)
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(folder)
        environment = {k: v for k, v in os.environ.items() if k not in _NOT_OURS}
        environment |= {"TERM": "xterm-256color", "PYTHONPATH": str(ROOT)}
        time.sleep(0.1)  # until the terminal has its size
        os.execve(sys.executable, [sys.executable, "-c", program, *map(str, arguments)], environment)
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    moment: list[str] = []
    end = time.monotonic() + PATIENCE
    try:
        while chunk := _read(terminal, end):
            stream.feed(chunk)
            if when and not moment and any(re.search(when, line) for line in screen.display):
                moment = _lines(screen)
    finally:
        if time.monotonic() > end:
            os.kill(pid, signal.SIGKILL)
        _, status = os.waitpid(pid, 0)
        os.close(terminal)
    return Shown(_lines(screen), len(screen.history.top), moment, os.waitstatus_to_exitcode(status))


def _read(terminal: int, end: float) -> bytes:
    """The next output; empty once the program has ended or takes too long."""
    ready, _, _ = select.select([terminal], [], [], max(end - time.monotonic(), 0.0))
    try:
        return os.read(terminal, 65536) if ready else b""
    except OSError:  # Linux raises EIO once a terminal's other side is closed
        return b""


def _lines(screen) -> list[str]:
    lines = [line.rstrip() for line in screen.display]
    while lines and not lines[-1]:
        lines.pop()
    return lines
