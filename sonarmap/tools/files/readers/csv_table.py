"""CSV files of spreadsheets and loggers: comma, semicolon or tab, decimal commas, byte-order marks, UTF-16."""

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

# Start of a cell that a spreadsheet would evaluate as a formula (with full-width signs in Japanese ones). Our files put
# an apostrophe before such a text, which marks it as text for spreadsheets.
_FORMULA = re.compile("'*[=+\\-@\uff1d\uff0b\uff0d\uff20]")
_CONTROL = re.compile(r"[\x00-\x1f\x7f\x85\u2028\u2029]")
# Texts in lower case that logs write for a missing value
MISSING = frozenset(("", "nan", "n/a", "na", "null", "none", "-", "--", "---"))
_DEGREES = re.compile(
    r"([NSEW])?\s*([+-]?)(\d+(?:[.,]\d*)?|[.,]\d+)\s*[°ºd]?"  # degrees
    r"(?:[\s:-]*(?<![\d.,])(\d{1,2}(?:[.,]\d*)?)\s*['′’m]?)?"  # minutes, behind a sign or a blank
    r"(?:[\s:-]*(?<![\d.,])(\d{1,2}(?:[.,]\d*)?)\s*(?:\"|″|”|''|′′|’’)?)?"  # seconds
    r"\s*([NSEW])?",
    re.IGNORECASE,
)
_HEMISPHERES = {"lat_deg": "NS", "lon_deg": "EW"}
PAIRS = "pairs.csv"  # table of registered pairs in the folder of `sonarmap map`
SUMMARY = "summary.json"  # summary of a finished map in its folder


@dataclass(frozen=True, slots=True)
class CsvRow:
    """A row: its line number in the file, and the texts of its cells (`text_of`), stripped of blanks."""

    line: int
    cells: list[str]


@dataclass(frozen=True, slots=True)
class CsvTable:
    path: Path
    heading: CsvRow  # the names of the columns
    rows: list[CsvRow]  # rows that are not blank, in the file's order
    notes: tuple[str, ...]  # messages for the user about how it was read
    is_whole: bool  # whether the last line ends with a line break

    def where(self, row: CsvRow | None = None) -> str:
        return f"{self.path}: line {(row or self.heading).line}"

    def require_even(self) -> None:
        """Raise InputError if a row has more or fewer cells than the heading."""
        wanted = len(self.heading.cells)
        for row in self.rows:
            if len(row.cells) != wanted:
                cut = "" if self.is_whole or row is not self.rows[-1] else "; the file may have been cut there"
                raise InputError(f"{self.where(row)}: it has {len(row.cells)} cells, the heading {wanted}{cut}; fix it")

    def rows_by_name(self, columns: Mapping[str, int]) -> Iterator[tuple[str, dict[str, str]]]:
        """For each row its file and line, for messages, and the cells of `columns` by name."""
        self.require_even()
        return ((self.where(row), {name: row.cells[k] for name, k in columns.items()}) for row in self.rows)

    def declared_columns(
        self, known: Sequence[str], required: Sequence[str], words: str, missing: str = ""
    ) -> dict[str, int]:
        """Index of each column by its lower-case name, for a table that a person fills in. The error about an unknown
        column says that `words` are wanted; that about a missing one of `required` says `missing`."""
        names = [cell.lower() for cell in self.heading.cells]
        for k, name in enumerate(names):
            if name not in known:
                raise InputError(
                    f"{self.where()}: there is a column {self.heading.cells[k][:40]!r}; wanted {words}; rename it"
                )
            if name in names[:k]:
                raise InputError(f"{self.where()}: there are two columns {name}; delete one")
        for name in required:
            if name not in names:
                raise InputError(f"{self.where()}: there is no column {name}; {missing}add it")
        return {name: k for k, name in enumerate(names)}


def read_csv_table(path: Path) -> CsvTable:
    """Read the table of a file, without blank rows and lines that begin with #, unless the heading does. The separator
    is the most frequent of comma, semicolon and tab in the heading; with the latter two a decimal comma becomes a
    point."""
    lines, whole = _lines(path)
    if not lines:
        raise InputError(f"{path} holds no line but comments; wanted a heading and rows")
    separator = max(SEPARATORS, key=lines[0][1].count)
    heading, *rows = (_row(path, number, line, separator) for number, line in lines)
    rows = [row for row in rows if any(row.cells)]
    note = f"{path}: its last line has no line break; if the file was cut, a number there may have lost digits"
    return CsvTable(path, heading, rows, () if whole else (note,), whole)


def _lines(path: Path) -> tuple[list[tuple[int, str]], bool]:
    """The lines that are neither blank nor comments, numbered from 1, and whether the last ends with a line break."""
    content = read_content(path, pipe=True)
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        try:
            content = content.decode("utf-16").encode()
        except UnicodeDecodeError as error:
            raise InputError(f"{path} begins as UTF-16 but is not: {error}; save it as CSV in UTF-8") from error
    content = content.removeprefix(codecs.BOM_UTF8)
    lines, comment = list[tuple[int, str]](), (0, "")
    for number, line in enumerate(content.splitlines(), 1):
        if not line.strip():
            continue
        try:
            text = line.decode("utf-8", "replace" if line.lstrip().startswith(b"#") else "strict")
        except UnicodeDecodeError as error:
            raise InputError(f"{path}: line {number} is not a CSV line in UTF-8: {error}") from error
        if text.lstrip().startswith("#"):
            comment = (number, text.strip("# \t"))
            continue
        if not lines and _heads(comment[1], text):
            lines.append(comment)
        lines.append((number, text))
    return lines, not content or content.endswith((b"\n", b"\r"))


def _heads(comment: str, line: str) -> bool:
    """Whether a comment has the names of the columns of numbers below it, as in EuRoC files."""
    separator = max(SEPARATORS, key=comment.count)
    cells = line.split(separator)
    return comment.count(separator) + 1 == len(cells) > 1 and all(np.isfinite(number(cell)) for cell in cells)


def _row(path: Path, number: int, line: str, separator: str) -> CsvRow:
    try:
        cells = [text_of(cell.strip()) for cell in next(csv.reader([line], delimiter=separator, strict=True))]
    except csv.Error as error:
        raise InputError(f"{path}: line {number} is not a CSV line: {error}; save the file as CSV in UTF-8") from error
    return CsvRow(number, cells if separator == "," else [_with_point(cell) for cell in cells])


def _with_point(cell: str) -> str:
    """The cell with a point for a decimal comma if it is a number; anything else unchanged."""
    changed = cell.replace(",", ".")
    is_number = cell.count(",") == 1 and "." not in cell and np.isfinite(number(changed))
    return changed if is_number else cell


def cell_of(text: str) -> str:
    """The cell for a text, which `text_of` turns back into `plain_text(text)`; numbers are unchanged."""
    text = plain_text(text)
    return f"'{text}" if _FORMULA.match(text) and np.isnan(number(text)) else text


def text_of(cell: str) -> str:
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell


def plain_text(text: str) -> str:
    """The text on one line, stripped of blanks, with backslash escapes for what is not UTF-8."""
    return _CONTROL.sub(" ", text).encode("utf-8", "backslashreplace").decode().strip()


def number(cell: str) -> float:
    """The finite number in a cell; NaN for anything else."""
    try:
        value = float(cell) if "_" not in cell else np.nan
    except ValueError:
        return np.nan
    return value if np.isfinite(value) else np.nan


def numbers(cells: Sequence[str], strict: bool) -> tuple[np.ndarray, np.ndarray]:
    """The numbers (n,) of a column, NaN where there is none, and (n,) bool where a cell is neither a number nor a
    missing value. `strict`: only an empty cell is a missing value, not the words in MISSING."""
    values = np.array([number(cell) for cell in cells], np.float64)
    empty = [not cell or (not strict and cell.lower() in MISSING) for cell in cells]
    return values, np.isnan(values) & ~np.array(empty, bool)


def index_of(cell: str, count: int) -> int | None:
    """The whole number below `count` in a cell; None for anything else."""
    index = int(cell) if cell.isascii() and cell.isdecimal() and len(cell) < 10 else count
    return index if index < count else None


def degrees(cell: str, quantity: str) -> float:
    """Decimal degrees of a latitude or longitude ("lat_deg" or "lon_deg"); NaN for anything else. Accepted are
    decimal degrees, degrees and decimal minutes, and degrees, minutes and seconds, with a sign or with N, S, E or W
    before or after: `-5.3221`, `60 23.478 N`, `60°23'28.7"N`, `W 5:19,3`."""
    plain = number(cell)
    if np.isfinite(plain):
        return plain
    parts = _DEGREES.fullmatch(" ".join(cell.split()))  # runs of blanks would make the expression backtrack
    if not parts or (parts[1] and parts[6]):
        return np.nan
    half = (parts[1] or parts[6] or "").upper()
    texts = [part.replace(",", ".") for part in parts.group(3, 4, 5) if part]
    whole, minutes, seconds = (*(float(text) for text in texts), 0.0, 0.0)[:3]
    is_exact = not any("." in text for text in texts[:-1])  # only the last part has decimals
    if not is_exact or minutes >= 60 or seconds >= 60 or (half and (parts[2] or half not in _HEMISPHERES[quantity])):
        return np.nan
    return (whole + minutes / 60 + seconds / 3600) * (-1 if parts[2] == "-" or half in ("S", "W") else 1)


def place_of(text: str) -> list[float]:
    """Latitude, longitude [deg] and any further numbers, separated by commas or, with decimal commas, by semicolons;
    NaN for anything else: `60.3913,5.3221`, `60°23.478'N, 5°19.326'E, 2.5`, `60,3913; 5,3221`."""
    parts = [part.strip() for part in text.split(";" if ";" in text else ",")]
    angles = [degrees(part, quantity) for part, quantity in zip(parts, _HEMISPHERES, strict=False)]
    return [*angles, *(number(part.replace(",", ".")) for part in parts[2:])]


def refuse(where: str, heading: str, cell: str, wanted: str) -> InputError:
    return InputError(f"{where}: {heading} is {cell[:40]!r}; wanted {wanted}; fix that line")


def number_within(where: str, name: str, cell: str, bounds: tuple[float, float], wanted: str) -> float:
    """The number in a cell. Raises InputError: it is not a number within `bounds`."""
    value = number(cell)
    if not bounds[0] <= value <= bounds[1]:
        raise refuse(where, name, cell, wanted)
    return value
