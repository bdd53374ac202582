"""Tables of text: for Markdown, for a terminal, and as CSV."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from sonarmap.tools.files.writers.table import write_table

Group = TypeVar("Group")


@dataclass(frozen=True, slots=True)
class Table:
    """Headings, and rows with as many cells each."""

    title: str  # a line over it
    headings: tuple[str, ...]  # of the columns
    rows: tuple[tuple[str, ...], ...]  # the cells, as they are shown

    def markdown(self) -> str:
        """As GitHub shows it, the title in bold."""
        lines = [self.headings, ("---",) * len(self.headings), *self.rows]
        cells = (" | ".join(cell.replace("|", "\\|") for cell in line) for line in lines)
        return f"**{self.title}**\n\n" + "".join(f"| {line} |\n" for line in cells)

    def rich(self) -> Any:
        """As rich prints it."""
        from sonarmap.tools.lab.wide_table import WideTable

        return WideTable(self.headings, self.rows, title=self.title)


def table_of(
    title: str,
    names: tuple[str, ...],
    groups: Iterable[tuple[tuple[str, ...], Group]],
    columns: Mapping[str, Callable[[Group], str]],
) -> Table:
    """A line for each group: its names, under the headings `names`, then what each column shows of it."""
    rows = tuple((*named, *(cell(group) for cell in columns.values())) for named, group in groups)
    return Table(title, (*names, *columns), rows)


def write_csv(path: Path, headings: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write rows under their headings: floats with four decimals, truth values as 1 and 0, nothing for NaN."""
    write_table(path, headings, ([_cell(value) for value in row] for row in rows))


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:z.4f}"
    return str(value)
