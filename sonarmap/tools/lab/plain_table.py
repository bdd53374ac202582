"""A table at a terminal: names to the left, numbers to the right; long words are wrapped, and nothing is cut."""

from collections.abc import Iterable, Sequence

from rich.table import Table
from rich.text import Text


def plain_table(
    headings: Sequence[str], rows: Iterable[Sequence[str | Text]], title: str = "", names: Sequence[str] = ()
) -> Table:
    """The rows below their headings; `names` are columns of words beside the first one."""
    table = Table(box=None, pad_edge=False, title=title or None, title_justify="left", title_style="bold")
    for k, heading in enumerate(headings):
        table.add_column(heading, justify="right" if k and heading not in names else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table
