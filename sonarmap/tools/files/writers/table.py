"""CSV tables, as all of them are written: commas, UTF-8, a heading, and no formula in any cell."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from sonarmap.tools.files.readers.csv_table import cell_of
from sonarmap.tools.files.writers.atomic import atomic_path

# Some spreadsheets divide cells at semicolons too; a line that begins with # would be a comment.
_QUOTED = re.compile(r'[",;]|^#')


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """Write rows of texts and numbers under their columns' names; a text as `cell_of` has it."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"{','.join(map(_quoted, cells))}\n" for cells in (columns, *rows))


def _quoted(value: object) -> str:
    cell = cell_of(str(value))
    return '"' + cell.replace('"', '""') + '"' if _QUOTED.search(cell) else cell
