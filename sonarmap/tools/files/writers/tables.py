"""Writers of CSV tables, priors files and their templates, and JSON."""

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.csv_table import cell_of
from sonarmap.tools.files.readers.instruments import COLUMNS, SIGMA_COLUMNS, sigmas_of, values_of
from sonarmap.tools.files.writers.atomic import atomic_path

# Cells to quote: some spreadsheets split at semicolons too, and a line that begins with # would be a comment.
_QUOTED = re.compile(r'[",;]|^#')


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """Write rows of texts and numbers below a heading of column names; `cell_of` escapes texts."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"{','.join(map(_quoted, cells))}\n" for cells in (columns, *rows))


def _quoted(value: object) -> str:
    cell = cell_of(str(value))
    return '"' + cell.replace('"', '""') + '"' if _QUOTED.search(cell) else cell


def require_new(path: Path) -> None:
    """Raise InputError if the file exists: overwriting it would lose what a user filled in."""
    if path.exists():
        raise InputError(f"{path} exists already; remove it, or give the template another name")


def write_template(path: Path, names: Sequence[str], stamps: Sequence[float]) -> None:
    """Write a priors template to fill in: per scan a row with its name and stamp [s] and empty measurements."""
    require_new(path)
    empty = [""] * (len(COLUMNS) + len(SIGMA_COLUMNS))
    rows = ([name, f"{stamp:.6f}", *empty] for name, stamp in zip(names, stamps, strict=True))
    write_table(path, ["name", "stamp", *COLUMNS, *SIGMA_COLUMNS], rows)


def write_priors(path: Path, names: Sequence[str], priors: Sequence[PosePrior]) -> None:
    """Write one row per scan with the columns that at least one scan measured; a cell not measured is empty."""
    values = np.array([values_of(prior.T_world_sensor) for prior in priors])
    sigmas = np.array([sigmas_of(prior) for prior in priors])
    known = np.isfinite(sigmas)
    columns = np.flatnonzero(known.any(axis=0))
    rows: list[list[str]] = []
    for row, name in enumerate(names):
        measured = [f"{values[row, k]:z.6f}" if known[row, k] else "" for k in columns]
        deviations = [f"{sigmas[row, k]:.6g}" if known[row, k] else "" for k in columns]
        rows.append([name, *measured, *deviations])
    write_table(path, ["name", *(COLUMNS[k] for k in columns), *(SIGMA_COLUMNS[k] for k in columns)], rows)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a mapping of values that `to_json` accepts as JSON, with a line per key of a mapping, and per item of a
    list of lists or mappings. Raises TypeError: a value that JSON cannot represent; InputError: the file cannot be
    written."""
    text = _in_lines(to_json(content))
    with atomic_path(path) as temporary:
        # A file name that is not UTF-8 holds lone surrogates; backslashreplace writes them as JSON escapes.
        temporary.write_bytes(f"{text}\n".encode("utf-8", "backslashreplace"))


def _in_lines(value: Any, indent: str = "\n") -> str:
    """JSON text of a value, one item per line; `indent` is a line break and the blanks before the closing bracket."""
    deeper = indent + "  "
    if isinstance(value, dict) and value:
        items = (f"{_in_line(name)}: {_in_lines(item, deeper)}" for name, item in value.items())
        return f"{{{deeper}{f',{deeper}'.join(items)}{indent}}}"
    if isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        return f"[{deeper}{f',{deeper}'.join(map(_in_line, value))}{indent}]"
    return _in_line(value)


def _in_line(value: Any) -> str:
    return json.dumps(value, allow_nan=False, ensure_ascii=False)


def to_json(value: Any) -> Any:
    """Convert a value to JSON's types, including NumPy values, dataclasses, tuples, sets and paths; NaN and infinity
    become null. Raises TypeError: a value that JSON cannot represent."""
    if isinstance(value, np.ndarray | np.generic):
        return to_json(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, Mapping):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_json(item) for item in value]
    if isinstance(value, set | frozenset):
        return sorted(to_json(item) for item in value)
    if isinstance(value, Path):
        return str(value)
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_json(getattr(value, field.name)) for field in fields(value)}
    raise TypeError(f"JSON cannot represent a {type(value).__name__}; give numbers, text, lists or mappings")
