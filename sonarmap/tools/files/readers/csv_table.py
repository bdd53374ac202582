"""CSV files as offices and loggers write them: comma, semicolon or tab, decimal commas, byte-order marks, UTF-16."""

import codecs
import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.user_file import read_content

SEPARATORS = (",", ";", "\t")

# A spreadsheet takes a cell that begins with one of these for a formula, whoever named the scan; the wide forms are of
# Japanese ones. Such a text has an apostrophe before it in our files, which says "text" to a spreadsheet's user.
_FORMULA = re.compile("'*[=+\\-@\uff1d\uff0b\uff0d\uff20]")
_CONTROL = re.compile(r"[\x00-\x1f\x7f\x85\u2028\u2029]")
# How logs say that nothing was measured, beside an empty cell
MISSING = frozenset(("", "nan", "n/a", "na", "null", "none", "-", "--", "---"))
_DEGREES = re.compile(
    r"([NSEW])?\s*([+-]?)(\d+(?:[.,]\d*)?|[.,]\d+)\s*[°ºd]?"  # degrees
    r"(?:[\s:-]*(?<![\d.,])(\d{1,2}(?:[.,]\d*)?)\s*['′’m]?)?"  # minutes, behind a sign or a blank
    r"(?:[\s:-]*(?<![\d.,])(\d{1,2}(?:[.,]\d*)?)\s*(?:\"|″|”|''|′′|’’)?)?"  # seconds
    r"\s*([NSEW])?",
    re.IGNORECASE,
)
_HALVES = {"lat_deg": "NS", "lon_deg": "EW"}
PAIRS = "pairs.csv"  # as `sonarmap map` calls the table of its pairs
SUMMARY = "summary.json"  # of a finished map's folder


@dataclass(frozen=True, slots=True)
class CsvRow:
    """A row: its `line` in the file, and its cells' texts (`text_of`) without blanks around them."""

    line: int
    cells: list[str]


@dataclass(frozen=True, slots=True)
class CsvTable:
    path: Path
    heading: CsvRow  # the names of the columns
    rows: list[CsvRow]  # that are not blank, in the file's order
    notes: tuple[str, ...]  # what a user should know of how it was read, in words
    is_whole: bool  # whether the last line ends with a line break

    def where(self, row: CsvRow | None = None) -> str:
        return f"{self.path}: line {(row or self.heading).line}"

    def require_even(self) -> None:
        """Refuse rows with more or fewer cells than the heading."""
        wanted = len(self.heading.cells)
        for row in self.rows:
            if len(row.cells) != wanted:
                cut = "" if self.is_whole or row is not self.rows[-1] else "; the file may have been cut there"
                raise InputError(
                    f"{self.where(row)}: it has {len(row.cells)} cells where the heading has {wanted}{cut}; fix that "
                    "line"
                )

    def rows_by_name(self, columns: Mapping[str, int]) -> Iterator[tuple[str, dict[str, str]]]:
        """Of each row where it is, for messages, and the cells of these columns by their names."""
        self.require_even()
        return ((self.where(row), {name: row.cells[k] for name, k in columns.items()}) for row in self.rows)

    def declared_columns(
        self, known: Sequence[str], required: Sequence[str], words: str, missing: str = ""
    ) -> dict[str, int]:
        """The place of each column of a table that a person fills in, by its name in small letters. `words` say what is
        wanted where a column has another name, `missing` where one of `required` is not there."""
        names = [cell.lower() for cell in self.heading.cells]
        for k, name in enumerate(names):
            if name not in known:
                raise InputError(
                    f"{self.where()}: there is a column {self.heading.cells[k][:40]!r}; wanted {words}; rename or "
                    "delete it"
                )
            if name in names[:k]:
                raise InputError(f"{self.where()}: there are two columns {name}; delete one")
        for name in required:
            if name not in names:
                raise InputError(f"{self.where()}: there is no column {name}; {missing}add it")
        return {name: k for k, name in enumerate(names)}


def read_csv_table(path: Path) -> CsvTable:
    """The table of a file without its blank rows and lines that begin with #. The separator is what the heading has
    most of: a comma, a semicolon or a tab; with the latter two a decimal comma is made a point."""
    lines, whole = _lines(path)
    if not lines:
        raise InputError(f"{path} holds no line but comments; wanted a heading and rows")
    separator = max(SEPARATORS, key=lines[0][1].count)
    heading, *rows = (_row(path, number, line, separator) for number, line in lines)
    rows = [row for row in rows if any(row.cells)]
    note = f"{path}: its last line has no line break; if the file was cut, a number there may have lost digits"
    return CsvTable(path, heading, rows, () if whole else (note,), whole)


def _lines(path: Path) -> tuple[list[tuple[int, str]], bool]:
    """The lines that are neither blank nor comments, numbered from 1; and whether the last one ends."""
    content = read_content(path, pipe=True)
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        try:
            content = content.decode("utf-16").encode()
        except UnicodeDecodeError as error:
            raise InputError(f"{path} begins as UTF-16 and is not: {error}; save it as CSV in UTF-8") from error
    content = content.removeprefix(codecs.BOM_UTF8)
    lines = []
    for number, line in enumerate(content.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith(b"#"):
            continue
        try:
            lines.append((number, line.decode()))
        except UnicodeDecodeError as error:
            raise InputError(
                f"{path}: line {number} is not a CSV line in UTF-8: {error}; save the file as CSV in UTF-8"
            ) from error
    return lines, not content or content.endswith((b"\n", b"\r"))


def _row(path: Path, number: int, line: str, separator: str) -> CsvRow:
    try:
        cells = [text_of(cell.strip()) for cell in next(csv.reader([line], delimiter=separator, strict=True))]
    except csv.Error as error:
        raise InputError(f"{path}: line {number} is not a CSV line: {error}; save the file as CSV in UTF-8") from error
    return CsvRow(number, cells if separator == "," else [_with_point(cell) for cell in cells])


def _with_point(cell: str) -> str:
    """A number with a decimal comma with a point; anything else as it is."""
    changed = cell.replace(",", ".")
    is_number = cell.count(",") == 1 and "." not in cell and np.isfinite(number(changed))
    return changed if is_number else cell


def cell_of(text: str) -> str:
    """The cell of a text; a number stays as it is. `text_of` gives `plain_text` of it again."""
    text = plain_text(text)
    return f"'{text}" if _FORMULA.match(text) and np.isnan(number(text)) else text


def text_of(cell: str) -> str:
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell


def plain_text(text: str) -> str:
    """A text as a cell can have it: on one line, without blanks around it, and what is no UTF-8 as its number."""
    return _CONTROL.sub(" ", text).encode("utf-8", "backslashreplace").decode().strip()


def number(cell: str) -> float:
    """The number in a cell; NaN for anything else, NaN and infinity included."""
    try:
        value = float(cell) if "_" not in cell else np.nan
    except ValueError:
        return np.nan
    return value if np.isfinite(value) else np.nan


def numbers(cells: Sequence[str], strict: bool) -> tuple[np.ndarray, np.ndarray]:
    """The (n,) numbers of a column, NaN where there is none, and (n,) whether a cell holds something else. `strict`:
    whether only an empty cell says that nothing was measured; otherwise also the words of logs."""
    values = np.array([number(cell) for cell in cells], np.float64)
    empty = [not cell or (not strict and cell.lower() in MISSING) for cell in cells]
    return values, np.isnan(values) & ~np.array(empty, bool)


def index_of(cell: str, count: int) -> int | None:
    """The whole number below `count` in a cell; None for anything else."""
    index = int(cell) if cell.isascii() and cell.isdecimal() and len(cell) < 10 else count
    return index if index < count else None


def degrees(cell: str, quantity: str) -> float:
    """Decimal degrees of a latitude or longitude ("lat_deg" or "lon_deg"); NaN for anything else. Understood are
    decimal degrees, degrees and decimal minutes, and degrees, minutes and seconds, with a sign or with N, S, E or W
    before or after: `-5.3221`, `60 23.478 N`, `60°23'28.7"N`, `W 5:19,3`."""
    plain = number(cell)
    if np.isfinite(plain):
        return plain
    parts = _DEGREES.fullmatch(" ".join(cell.split()))  # runs of blanks would be shared out in all ways
    if not parts or (parts[1] and parts[6]):
        return np.nan
    half = (parts[1] or parts[6] or "").upper()
    texts = [part.replace(",", ".") for part in parts.group(3, 4, 5) if part]
    whole, minutes, seconds = (*(float(text) for text in texts), 0.0, 0.0)[:3]
    is_exact = not any("." in text for text in texts[:-1])  # only the last part has decimals
    if not is_exact or minutes >= 60 or seconds >= 60 or (half and (parts[2] or half not in _HALVES[quantity])):
        return np.nan
    return (whole + minutes / 60 + seconds / 3600) * (-1 if parts[2] == "-" or half in ("S", "W") else 1)


def place_of(text: str) -> list[float]:
    """Latitude, longitude [deg] and the numbers behind them, separated by commas, or by semicolons, as decimal commas
    need; NaN for anything else: `60.3913,5.3221`, `60°23.478'N, 5°19.326'E, 2.5`, `60,3913; 5,3221`."""
    parts = [part.strip() for part in text.split(";" if ";" in text else ",")]
    angles = [degrees(part, quantity) for part, quantity in zip(parts, _HALVES, strict=False)]
    return [*angles, *(number(part.replace(",", ".")) for part in parts[2:])]


def refuse(where: str, heading: str, cell: str, wanted: str) -> InputError:
    return InputError(f"{where}: {heading} is {cell[:40]!r}; wanted {wanted}; fix that line")


def number_within(where: str, name: str, cell: str, bounds: tuple[float, float], wanted: str) -> float:
    """The number of a cell."""
    value = number(cell)
    if not bounds[0] <= value <= bounds[1]:
        raise refuse(where, name, cell, wanted)
    return value
