"""Progress on stderr: a bar with the time left on a terminal, now and then a line elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from tools.cli.terminal import error_console, printable, say

SECONDS_BETWEEN_LINES = 5.0

Step = Callable[[int, int, str], None]


@contextmanager
def progress(label: str, total: int, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Count `total` pieces of work; the block calls what it is given once after each.

    Args:
        label: what is being done, as in "registering pairs".
        total: number of pieces.
        quiet: say nothing at all (--quiet, --json).

    Yields:
        A function to call after every piece, with a few words about it or "".
    """
    done = 0
    with growing_progress(label, quiet) as step:

        def advance(note: str) -> None:
            nonlocal done
            done += 1
            step(done, total, note)

        step(0, total, "")
        yield advance


@contextmanager
def growing_progress(label: str, quiet: bool = False) -> Iterator[Step]:
    """Follow work whose end moves while it is done.

    Args:
        label: what is being done, as in "mapping".
        quiet: say nothing at all (--quiet, --json).

    Yields:
        A function to call as step(pieces done, pieces planned so far, words about the last one).
    """
    console = error_console()
    if quiet:
        yield lambda _done, _planned, _note: None
    elif console.is_terminal:
        with _bar(console) as bar:
            task = bar.add_task(printable(label), total=None, note="")
            yield lambda done, planned, note: bar.update(task, completed=done, total=planned, note=printable(note))
    else:
        lines = _Lines(label)
        yield lines.step
        lines.end()


def _bar(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left", markup=False),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}", markup=False),
        console=console,
    )


class _Lines:
    """Says how far it is, at most every few seconds and at the end."""

    def __init__(self, label: str) -> None:
        self.label = label
        self.start = self.said = time.monotonic()
        self.unsaid = ""

    def step(self, done: int, planned: int, note: str) -> None:
        now = time.monotonic()
        elapsed = now - self.start
        left = f", about {elapsed / done * (planned - done):.0f} s left" if 0 < done < planned else ""
        self.unsaid = f"{self.label}: {done} of {planned}, {elapsed:.1f} s{left}" + (f" ({note})" if note else "")
        if now - self.said >= SECONDS_BETWEEN_LINES:
            self.said = now
            self.end()

    def end(self) -> None:
        if self.unsaid:
            say(self.unsaid)
            self.unsaid = ""
