"""How something that goes on is shown: in place on a terminal, and now and then elsewhere."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

from rich.live import Live
from rich.text import Text

from sonarmap.tools.command.terminal import error_console, printable, say, warn

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
