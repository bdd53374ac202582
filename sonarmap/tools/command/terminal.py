"""Messages to the user, on stderr, so that stdout is for results alone."""

import json
import logging
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.text import Text

if TYPE_CHECKING:
    from rich.table import Table

_WIDTH_OF_FILES = 200  # a table in a file need not be folded
_LONGEST = 3000  # characters of a message
_bars: list[Console] = []  # the consoles on stderr that show one: what is said stands above it
_quiet: list[bool] = []  # of this program, whatever thread speaks; the last counts


class PipedConsole(Console):
    """A console whose reader may leave."""

    def on_broken_pipe(self) -> None:
        """Leave it to the entry point, which knows the exit code."""
        raise BrokenPipeError


def error_console() -> Console:
    """A console on stderr as it is now (a test or a pipe may have replaced it since the start)."""
    return _bars[-1] if _bars else PipedConsole(stderr=True, highlight=False)


@contextmanager
def below_messages(console: Console) -> Iterator[None]:
    """Within the block, `console` shows a bar at the bottom of the screen."""
    _bars.append(console)
    try:
        yield
    finally:
        _bars.pop()


def result_console() -> Console:
    """A console on stdout for tables: as wide as the terminal, or wide if there is none."""
    return PipedConsole(width=result_width(), highlight=False)


def result_width() -> int | None:
    """Columns of stdout; None for those of the terminal."""
    return None if sys.stdout.isatty() else _WIDTH_OF_FILES


def print_result(sentence: str) -> None:
    """Print a sentence on stdout, wrapped by words on a terminal and on one line elsewhere; brackets are not markup."""
    result_console().print(Text(printable(sentence)), soft_wrap=not sys.stdout.isatty())


def print_json(value: Any, indent: int | None = None) -> None:
    """Print a value that `to_json` takes on stdout; what is not a finite number is null."""
    from sonarmap.tools.files.writers.tables import to_json

    typer.echo(json.dumps(to_json(value), indent=indent, allow_nan=False))


def print_rows(rows: Mapping[str, str]) -> None:
    """Print names on the left, and what is to be said of each beside it, on as many lines as it takes."""
    from rich.padding import Padding
    from rich.table import Table

    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True)
    for name, words in rows.items():
        table.add_row(name, Text(printable(words)))
    result_console().print(Padding(table, (0, 0, 0, 2), expand=False))


def number_table(*names: str, words: int = 0) -> "Table":
    """A table of numbers, of which none is cut; the first columns, as many as `words`, hold text."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for number, name in enumerate(names):
        is_text = number < words
        table.add_column(Text(name), justify="left" if is_text else "right", no_wrap=not is_text, overflow="fold")
    return table


@contextmanager
def quietly(quiet: bool, results: bool) -> Iterator[None]:
    """Within the block, if `quiet`, only labeled messages are said, warnings and errors, and of what is printed on
    stdout nothing but wanted `results`."""
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
    """Print a plain message on stderr, wrapped on a terminal and on one line elsewhere.

    Brackets are not markup, control characters are shown escaped, and what is too long for anybody to read is left out
    of its middle. The label, as "error: ", is printed before it in rich's `style`.
    """
    message = printable(shortened(message))
    if any(_quiet[-1:]) and not label:
        return
    console = error_console()
    console.print(Text.assemble((label, style), message), soft_wrap=not console.is_terminal)


def warn(message: str) -> None:
    """Print on stderr what the user should look at."""
    say(message, "warning: ", "bold yellow")


def shortened(message: str, longest: int = _LONGEST) -> str:
    """The message, or its beginning and its end, where it quotes all of a damaged file's cell or heading."""
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
    """Show what the library logs under "sonarmap" from now on."""
    logger = logging.getLogger("sonarmap")
    logger.setLevel(logging.INFO)
    logger.addHandler(_Messages())
