"""Messages and progress on stderr, so that stdout is for results alone."""

import json
import logging
import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console, RenderableType
from rich.live import Live
from rich.progress import BarColumn, Progress, Task, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Column
from rich.text import Text

if TYPE_CHECKING:
    from rich.table import Table

_WIDTH_OF_FILES = 200  # columns of tables where stdout is not a terminal
_LONGEST = 3000  # characters of a message
_bars: list[Console] = []  # consoles on stderr with a progress bar; messages appear above it
_quiet: list[bool] = []  # for all threads of this program; the last counts


class PipedConsole(Console):
    """A console that raises BrokenPipeError if its pipe is closed."""

    def on_broken_pipe(self) -> None:
        """Raise the error for the entry point, which returns the exit code."""
        raise BrokenPipeError


def error_console() -> Console:
    """A console on stderr as it is now (a test or a pipe may have replaced it since the start)."""
    return _bars[-1] if _bars else PipedConsole(stderr=True, highlight=False)


@contextmanager
def below_messages(console: Console) -> Iterator[None]:
    """Within the block, messages are printed above the progress bar of `console`."""
    _bars.append(console)
    try:
        yield
    finally:
        _bars.pop()


def result_console() -> Console:
    """A console on stdout for tables: as wide as the terminal, or wide if there is none."""
    return PipedConsole(width=result_width(), highlight=False)


def result_width() -> int | None:
    """Columns of stdout; None if it is a terminal."""
    return None if sys.stdout.isatty() else _WIDTH_OF_FILES


def print_result(sentence: str) -> None:
    """Print a sentence on stdout, wrapped by words on a terminal and on one line elsewhere; brackets are not markup."""
    result_console().print(Text(printable(sentence)), soft_wrap=not sys.stdout.isatty())


def print_json(value: Any, indent: int | None = None) -> None:
    """Print a value that `to_json` accepts on stdout; NaN and infinity become null."""
    from sonarmap.tools.files.writers.tables import to_json

    typer.echo(json.dumps(to_json(value), indent=indent, allow_nan=False))


def print_rows(rows: Mapping[str, str]) -> None:
    """Print names on the left and their texts beside them, which may take several lines."""
    from rich.padding import Padding
    from rich.table import Table

    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True)
    for name, words in rows.items():
        table.add_row(name, Text(printable(words)))
    result_console().print(Padding(table, (0, 0, 0, 2), expand=False))


def number_table(*names: str, words: int = 0) -> "Table":
    """A table whose numbers are never cut; the first `words` columns hold text."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for number, name in enumerate(names):
        is_text = number < words
        table.add_column(Text(name), justify="left" if is_text else "right", no_wrap=not is_text, overflow="fold")
    return table


@contextmanager
def quietly(quiet: bool, results: bool) -> Iterator[None]:
    """Within the block, if `quiet`, print only labeled messages, which are warnings and errors, and nothing on stdout
    unless `results`."""
    _quiet.append(quiet)
    try:
        if results or not quiet:
            yield
        else:
            with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):  # noqa: PTH123
                yield
    finally:
        _quiet.pop()


def say(message: str, label: str = "", style: str = "") -> None:
    """Print a plain message on stderr, wrapped on a terminal and on one line elsewhere. Brackets are not markup,
    control characters are shown escaped, and a long message is shortened in the middle. The label, as "error: ", is
    printed before it in rich's `style`."""
    message = printable(shortened(message))
    if any(_quiet[-1:]) and not label:
        return
    console = error_console()
    console.print(Text.assemble((label, style), message), soft_wrap=not console.is_terminal)


def warn(message: str) -> None:
    """Print a warning on stderr."""
    say(message, "warning: ", "bold yellow")


def shortened(message: str, longest: int = _LONGEST) -> str:
    """The message; one that is too long, as it quotes a damaged file, without its middle."""
    if len(message) <= longest:
        return message
    return f"{message[: longest // 2]} [... {len(message) - longest:,} characters ...] {message[-longest // 2 :]}"


def printable(text: str) -> str:
    """The text with every control character escaped: file names may hold anything."""
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)


class _Messages(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        (warn if record.levelno >= logging.WARNING else say)(record.getMessage())


def show_messages() -> None:
    """Print what the library logs under "sonarmap" from now on."""
    logger = logging.getLogger("sonarmap")
    logger.setLevel(logging.INFO)
    logger.addHandler(_Messages())


SECONDS_BETWEEN_LINES = 5.0
WINDOW = 60.0  # [s] whose rate gives the time left: pairs from a journal come faster than others
_WIDEST_BAR = 40  # of a terminal's columns
_LABEL, _COUNT, _TIMES = 11, 11, 28  # columns of the label, the count and the two times
Step = Callable[[int, int, str], None]


_followers: list[Callable[[str], None]] = []


@contextmanager
def followed(follow: Callable[[str], None]) -> Iterator[None]:
    """Within the block, call `follow` with the progress of all work in words."""
    _followers.append(follow)
    try:
        yield
    finally:
        _followers.remove(follow)


@contextmanager
def progress(label: str, total: int, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Show the progress of `total` pieces of work; yields a function to call after each with words about it, or ""."""
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
    """Show that work without counted pieces goes on; the arguments are those of `growing_progress`."""
    with growing_progress(label, quiet) as step:
        yield
        step(1, 1, "")


@contextmanager
def growing_progress(label: str, quiet: bool = False) -> Iterator[Step]:
    """Show the progress of work whose total may change, labeled as in "mapping"; if `quiet` (--quiet, --json) print
    nothing. Yields a function to call as step(pieces done, pieces planned, words about the last one)."""
    console = error_console()
    on_terminal = console.is_terminal and not quiet
    bar, lines = _Bar(console, printable(label), on_terminal), None if quiet or on_terminal else _Lines(label)

    def step(done: int, planned: int, note: str) -> None:
        bar.show(done, planned, note)
        for follow in _followers:
            follow(f"{label}: {done} of {planned}" if planned > 1 else label)
        if lines is not None:
            lines.step(bar.tasks[0], note)

    with bar.shown() if on_terminal else nullcontext():
        yield step
    if lines is not None:
        lines.end()


class _Bar(Progress):
    """A line with label, bar, count and times, and below it words about the last piece; both fit the width. It counts
    even if it is not shown."""

    def __init__(self, console: Console, label: str, is_shown: bool) -> None:
        self._note, fixed = "", Column(no_wrap=True)
        room = console.width - max(len(label), _LABEL) - _COUNT - _TIMES - 4
        count = Column(no_wrap=True, min_width=7, justify="right")
        super().__init__(
            TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True, min_width=_LABEL)),
            BarColumn(max(min(_WIDEST_BAR, room), 4)),
            TextColumn("{task.fields[count]}", "progress.download", table_column=count),
            TimeElapsedColumn(table_column=fixed),
            TimeRemainingColumn(table_column=fixed),
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
        self.tasks[0].total = planned  # `update` would reset the rate
        self.update(self._work, completed=done, count=f"{done}/{planned}" if planned > 1 else "")

    def get_renderables(self) -> Iterable[RenderableType]:
        yield from super().get_renderables()
        if self._note:
            yield Text(f"  {self._note}", style="dim", no_wrap=True, overflow="ellipsis")


class _Lines:
    """Prints progress in lines, SECONDS_BETWEEN_LINES apart, and at the end."""

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


_BETWEEN = 10.0  # between status messages where stderr is not a terminal [s]
Show = Callable[[Sequence[str], Sequence[str], str], None]


@contextmanager
def status_line(quiet: bool) -> Iterator[Show]:
    """Yields a function that shows lines, with warnings above them, and takes the status in a word; "lost" is shown in
    red. Where stderr is not a terminal, the lines are printed every ten seconds and whenever the status changes. A
    terminal that was closed raises nothing at the end of the block."""
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
