"""Tables of an experiment's rows: selecting rows, grouping them, and formatting a cell of each group."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd
from scipy.stats import binomtest

from sonarmap.tools.lab.reproduce.experiments import Row

DASH = "–"  # for a missing value
Frame = Any  # a pandas DataFrame, as pandas has no types
Cell = Callable[[Frame], str]


@dataclass(frozen=True, slots=True)
class Table:
    """A table with a line per group of rows; conditions are for pandas' `eval`, such as "accepted and not right"."""

    title: str
    by: tuple[str, ...]  # columns whose values define the groups and name the lines
    cells: Mapping[str, Cell]  # heading -> formats the rows of a group
    rows: str | Callable[[Frame], Frame] = ""  # a condition, or a function that selects and changes the rows
    across: str = ""  # column whose values are shown side by side, each with all the cells
    total: str = ""  # name of a last line for all rows; "" for none
    times: bool = False  # whether it shows run times, which differ between runs


@dataclass(frozen=True, slots=True)
class Rendered:
    """A formatted table: a title, headings, and rows of cells."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def markdown(self) -> str:
        """The table in GitHub's Markdown, the title in bold."""
        lines = [self.headings, ("---",) * len(self.headings), *self.rows]
        cells = (" | ".join(cell.replace("|", "\\|") for cell in line) for line in lines)
        return f"**{self.title}**\n\n" + "".join(f"| {line} |\n" for line in cells)


def frame_of(rows: Sequence[Row]) -> Frame:
    """The rows as a pandas DataFrame, with a column for every key in order of first appearance."""
    frame: Frame = pd.DataFrame([dict(row) for row in rows])
    for name, column in frame.items():  # Booleans that some rows lack
        if column.dtype == object and column.map(type).isin((bool, float)).all():
            frame[name] = column.astype("boolean")
    return frame


def where(frame: Frame, condition: str) -> Frame:
    """The rows that meet a condition: all if it is empty, none if its columns are missing."""
    if not condition or frame.empty:
        return frame
    try:
        fulfilled = frame.eval(condition, engine="python")
    except pd.errors.UndefinedVariableError:
        return frame.iloc[:0]
    return frame[fulfilled.fillna(False).astype(bool)]


def render(table: Table, frame: Frame) -> Rendered | None:
    """The table of the rows that it selects from `frame`; None if it selects none."""
    selected = table.rows(frame) if callable(table.rows) else where(frame, table.rows)
    if selected.empty:
        return None
    parts = [None] if not table.across else _parts(selected[table.across])
    headings = [_joined(part, heading) for part in parts for heading in table.cells]
    lines = [(*names, *_cells(table, group, parts)) for names, group in _groups(table, selected)]
    return Rendered(table.title, (*map(_heading, table.by), *headings), tuple(lines))


def _parts(column: Any) -> list[Any]:
    """The values of a column; bins are in their order."""
    return [part for part in getattr(column.dtype, "categories", column.unique()) if (column == part).any()]


def _groups(table: Table, frame: Frame) -> Iterator[tuple[list[str], Frame]]:
    for names, group in frame.groupby(list(table.by), sort=False, dropna=False, observed=True):
        yield [_shown(name) for name in names], group
    if table.total:
        yield [table.total, *[""] * (len(table.by) - 1)], frame


def _cells(table: Table, group: Frame, parts: Sequence[Any]) -> Iterator[str]:
    for part in parts:
        some = group if part is None else group[group[table.across] == part]
        yield from (cell(some) if len(some) else DASH for cell in table.cells.values())


def _joined(part: Any, heading: str) -> str:
    return heading if part is None else f"{_shown(part)}: {heading}" if heading else _shown(part)


def _heading(column: str) -> str:
    return {"sigma2": "σ² [m²]", "tilt_deg": "tilt [°]"}.get(column, column.replace("_", " "))


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def wilson(hits: int, trials: int) -> tuple[float, float]:
    """The 95 % Wilson interval of a rate (DOI 10.1080/01621459.1927.10502953), of one or more trials."""
    interval = binomtest(hits, trials).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def count(condition: str = "") -> Cell:
    """A cell with the number of rows that meet a condition."""
    return lambda frame: str(len(where(frame, condition)))


def share(condition: str, of: str = "", form: str = "count") -> Cell:
    """A cell with the number of the rows that meet `of` and also `condition`, with the 95 % interval of the rate: as
    "3/4 [0.30..0.95]", or with the form "percent" as "75 % [30..95]", or with "plain" as "3/4"."""

    def cell(frame: Frame) -> str:
        trials = where(frame, of)
        if trials.empty:
            return DASH
        hits, total = len(where(trials, condition)), len(trials)
        low, high = wilson(hits, total)
        if form == "percent":
            return f"{100 * hits / total:.0f} % [{100 * low:.0f}..{100 * high:.0f}]"
        return f"{hits}/{total}" + (f" [{low:.2f}..{high:.2f}]" if form == "count" else "")

    return cell


def ratio(hits: str, of: str) -> Cell:
    """A cell with the sum of a column over that of another, in percent."""

    def cell(frame: Frame) -> str:
        total = float(frame[of].sum())
        return f"{100 * float(frame[hits].sum()) / total:.1f} %" if total else DASH

    return cell


def number(of: str | Callable[[Frame], float], digits: int, how: str = "median", condition: str = "") -> Cell:
    """A cell with the median (or another pandas reduction, `how`) of a column over the rows that meet a condition, or
    with what a function computes from these rows."""

    def cell(frame: Frame) -> str:
        some = where(frame, condition)
        value = of(some) if callable(of) else float(getattr(some[of], how)()) if of in some else float("nan")
        return DASH if value != value else f"{value:,.{digits}f}"

    return cell


def joined(separator: str, *cells: Cell) -> Cell:
    """A cell that joins several cells."""
    return lambda frame: separator.join(cell(frame) for cell in cells)
