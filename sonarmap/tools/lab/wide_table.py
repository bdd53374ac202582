"""A table that no terminal is too narrow for: columns that do not fit stand below, behind their rows' names again."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

_GAP = 2  # columns between columns
_LONGEST = 36  # of a cell that is not wrapped
_HEADING = 12  # columns that a heading may take before it is wrapped
_LEAST = 8

Cell = str | Text


@dataclass(frozen=True, slots=True)
class WideTable:
    """Headings and rows, whose first cell names them. No number is cut: only long words are wrapped."""

    headings: Sequence[str]  # of the columns
    rows: Sequence[Sequence[Cell]]  # with as many cells each
    right: frozenset[int] = frozenset()  # which columns are justified to the right
    title: str = ""  # a line over it, "" for none

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """As many tables one below the other as the width needs."""
        if self.title:
            yield Text(self.title, style="bold")
        for number, (columns, widths) in enumerate(self._parts(options.max_width)):
            if number:
                yield Text()
            yield self._part(columns, widths)

    def _parts(self, width: int) -> Iterator[tuple[list[int], dict[int, int]]]:
        """The columns of each table, and how wide they are."""
        whole = {k: max(self._longest(k), cell_len(heading)) for k, heading in enumerate(self.headings)}
        if sum(whole.values()) + _GAP * (len(whole) - 1) <= width:
            yield list(whole), whole
            return
        narrow = {k: self._narrow(k) for k in whole}
        narrow[0] = min(narrow[0], max(width // 3, _LEAST))
        columns, left = [0], width - narrow[0]
        for k in list(narrow)[1:]:
            narrow[k] = min(narrow[k], max(width - narrow[0] - _GAP, _LEAST))
            if narrow[k] + _GAP > left and len(columns) > 1:
                yield columns, narrow
                columns, left = [0], width - narrow[0]
            columns.append(k)
            left -= narrow[k] + _GAP
        yield columns, narrow

    def _longest(self, column: int) -> int:
        return max((cell_len(line) for row in self.rows for line in str(row[column]).splitlines()), default=0)

    def _narrow(self, column: int) -> int:
        """As wide as its cells; headings and long cells are wrapped at their spaces."""
        longest = self._longest(column)
        words = [*self.headings[column].split()]
        if longest > _LONGEST:
            words += [word for row in self.rows for word in str(row[column]).split()]
            longest = _LONGEST
        return max([longest, min(cell_len(self.headings[column]), _HEADING), *map(cell_len, words)])

    def _part(self, columns: Sequence[int], widths: dict[int, int]) -> Table:
        table = Table(box=None, pad_edge=False, padding=(0, _GAP, 0, 0))
        for k in columns:
            justify = "right" if k in self.right else "left"
            table.add_column(Text(self.headings[k]), width=widths[k], justify=justify, overflow="fold")
        for row in self.rows:
            cells = [Text(cell) if isinstance(cell, str) else cell for cell in (row[k] for k in columns)]
            if len(columns) == len(self.headings) or any(cell.plain for cell in cells[1:]):
                table.add_row(*cells)
        return table
