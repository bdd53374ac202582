"""What a terminal shows of the laboratory: progress of long work, tables."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager

from rich.table import Table

# Follows work: label and number of pieces to a context that gives a function to call after each.
Follow = Callable[[str, int], AbstractContextManager[Callable[[str], None]]]


def plain_table(headings: Sequence[str], rows: Iterable[Sequence[str]], title: str = "") -> Table:
    """Names at the left, numbers at the right; long words are wrapped."""
    table = Table(box=None, pad_edge=False, title=title or None, title_justify="left", title_style="bold")
    for k, heading in enumerate(headings):
        table.add_column(heading, justify="right" if k else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table
