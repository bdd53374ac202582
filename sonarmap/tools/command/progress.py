"""How something that goes on is shown: progress as a bar or lines on stderr, and the state of a recording or a dive."""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from datetime import timedelta

from rich.console import Console, RenderableType
from rich.live import Live
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn
from rich.table import Column
from rich.text import Text

from sonarmap.tools.command.terminal import below_messages, error_console, printable, say, warn

SECONDS_BETWEEN_LINES = 5.0
WINDOW = 60.0  # the time left is by the rate of the last seconds: results of an earlier run come faster than others
_WIDEST_BAR = 40  # of a terminal's columns
_LABEL, _COUNT, _TIMES = 11, 11, 28  # columns that the words, the count, and the two times take at most

Step = Callable[[int, int, str], None]


@contextmanager
def progress(label: str, total: int, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Count `total` pieces of work, likewise: a function to call after each with a few words about it or ""."""
    done = 0
    with growing_progress(label, quiet) as step:

        def advance(note: str) -> None:
            nonlocal done
            done += 1
            step(done, total, note)

        step(0, total, "")
        yield advance


@contextmanager
def stage(label: str, quiet: bool = False) -> Iterator[None]:
    """Show that work goes on of which no pieces are counted; the arguments are those of `growing_progress`."""
    with growing_progress(label, quiet) as step:
        yield
        step(1, 1, "")


@contextmanager
def growing_progress(label: str, quiet: bool = False) -> Iterator[Step]:
    """Follow work whose total changes while it is done, named as in "mapping"; if `quiet` (--quiet, --json) print
    nothing.

    Yields a function to call as step(pieces done, pieces planned so far, words about the last one).
    """
    console = error_console()
    on_terminal = console.is_terminal and not quiet
    bar, lines = _Bar(console, printable(label), on_terminal), None if quiet or on_terminal else _Lines(label)

    def step(done: int, planned: int, note: str) -> None:
        bar.show(done, planned, note)
        if lines is not None:
            lines.step(bar.tasks[0], note)

    with bar.shown() if on_terminal else nullcontext():
        yield step
    if lines is not None:
        lines.end()


class _Bar(Progress):
    """One line with words, bar, count and times, at any width; below it, cut to the width, the last piece in words. It
    counts also where it is not shown."""

    def __init__(self, console: Console, label: str, is_shown: bool) -> None:
        self._note, fixed = "", Column(no_wrap=True)
        room = console.width - max(len(label), _LABEL) - _COUNT - _TIMES - 4
        count = Column(no_wrap=True, min_width=7, justify="right")
        super().__init__(
            TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True, min_width=_LABEL)),
            BarColumn(max(min(_WIDEST_BAR, room), 4)),
            TextColumn("{task.fields[count]}", "progress.download", table_column=count),
            TimeElapsedColumn(table_column=fixed),
            _Left(table_column=fixed),
            console=console,
            speed_estimate_period=WINDOW,
            get_time=lambda: time.monotonic(),
            disable=not is_shown,
        )
        self._work = self.add_task(label, total=None, count="")

    @contextmanager
    def shown(self) -> Iterator[None]:
        """The bar, as long as the block lasts; its last state stays."""
        with self, below_messages(self.console):
            try:
                yield
            finally:
                self._note = ""
                self.stop_task(self._work)

    def show(self, done: int, planned: int, note: str) -> None:
        self._note = " ".join(printable(note).split())
        self.tasks[0].total = planned  # `update` would forget how fast it goes
        self.update(self._work, completed=done, count=f"{done}/{planned}" if planned > 1 else "")

    def get_renderables(self) -> Iterable[RenderableType]:
        yield from super().get_renderables()
        if self._note:
            yield Text(f"  {self._note}", style="dim", no_wrap=True, overflow="ellipsis")


class _Left(ProgressColumn):
    """The time left, while the work goes on."""

    max_refresh = 0.5

    def render(self, task: Task) -> Text:
        if task.stop_time is not None or task.total is None:
            return Text("")
        left = task.time_remaining
        words = "-:--:-- left" if left is None else f"about {timedelta(seconds=left)} left"
        return Text(words, style="progress.remaining")


class _Lines:
    """Says how far the work is, at most every few seconds and at the end."""

    def __init__(self, label: str) -> None:
        self._label, self._pending, self._shown_at = label, "", time.monotonic()

    def step(self, task: Task, note: str) -> None:
        words = [f"{self._label}: {task.completed:.0f} of {task.total or 0:.0f}", f"{task.elapsed or 0:.1f} s"]
        if task.time_remaining:
            words.append(f"about {task.time_remaining:.0f} s left")
        self._pending = ", ".join(words) + (f" ({note})" if note else "")
        if (now := time.monotonic()) - self._shown_at >= SECONDS_BETWEEN_LINES:
            self._shown_at = now
            self.end()

    def end(self) -> None:
        if self._pending:
            say(self._pending)
            self._pending = ""


_BETWEEN = 10.0  # where no terminal shows it in place [s]
Show = Callable[[Sequence[str], Sequence[str], str], None]


@contextmanager
def status_line(quiet: bool) -> Iterator[Show]:
    """A function that shows lines, and says warnings above them. In a file the lines come every ten seconds, and
    whenever its last argument changes, which is what they are of in a word. "lost" is shown in red.

    A terminal that has gone before, or goes within the block, raises nothing at its end.
    """
    console, shown_at, shown = error_console(), -math.inf, ""

    def show(lines: Sequence[str], warnings: Sequence[str], status: str) -> None:
        nonlocal shown_at, shown
        for warning in warnings:
            warn(warning)
        words = [printable(line) for line in lines]
        if live is not None:
            style = "bold red" if status == "lost" else ""
            live.update(Text("\n".join(words), style, no_wrap=len(words) > 1, overflow="crop"), refresh=True)
        elif not quiet and (status != shown or time.monotonic() - shown_at >= _BETWEEN):
            shown_at, shown = time.monotonic(), status
            say("; ".join(words))

    live = Live(console=console, auto_refresh=False) if console.is_terminal and not quiet else None
    try:
        if live is not None:
            with suppress(OSError):
                live.start()
        yield show
    finally:
        if live is not None:
            with suppress(OSError):
                live.stop()
