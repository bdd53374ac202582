"""Progress on stderr: a bar with the time left on a terminal, now and then a line elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

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
    if quiet:
        yield lambda _note="": None
        return
    console = error_console()
    if not console.is_terminal:
        yield _lines(label, total)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left", markup=False),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}", markup=False),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(printable(label), total=total, note="")
        yield lambda note="": bar.update(task, advance=1, note=printable(note))


def _lines(label: str, total: int) -> Callable[[str], None]:
    """Say how far it is, at most every few seconds and always at the end."""
    start = said = time.monotonic()
    done = 0

    def advance(note: str = "") -> None:
        nonlocal done, said
        done += 1
        now = time.monotonic()
        if done < total and now - said < SECONDS_BETWEEN_LINES:
            return
        said = now
        left = (now - start) / done * (total - done)
        timing = f"{now - start:.1f} s" + (f", about {left:.0f} s left" if done < total else "")
        say(f"{label}: {done} of {total}, {timing}" + (f" ({note})" if note else ""))

    return advance
