"""Progress on stderr: on a terminal a bar with the time left, elsewhere a line every few seconds."""

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
    """Count `total` pieces of work; the block calls the function that it gets after each of them.

    Args:
        label: what is being done, as in "registering pairs".
        total: number of pieces.
        quiet: print nothing (--quiet, --json).

    Yields:
        A function to call after every piece of work, with a few words about it or "".
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
    """Follow work whose total changes while it is done.

    Args:
        label: what is being done, as in "mapping".
        quiet: print nothing (--quiet, --json).

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
    """Prints how far the work is, at most every few seconds and at the end."""

    def __init__(self, label: str) -> None:
        self.label = label
        self.start = self.printed_at = time.monotonic()
        self.pending = ""

    def step(self, done: int, planned: int, note: str) -> None:
        now = time.monotonic()
        elapsed = now - self.start
        left = f", about {elapsed / done * (planned - done):.0f} s left" if 0 < done < planned else ""
        self.pending = f"{self.label}: {done} of {planned}, {elapsed:.1f} s{left}" + (f" ({note})" if note else "")
        if now - self.printed_at >= SECONDS_BETWEEN_LINES:
            self.printed_at = now
            self.end()

    def end(self) -> None:
        if self.pending:
            say(self.pending)
            self.pending = ""
