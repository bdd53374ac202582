"""Tables as CSV, the template of a priors file, and values of any kind as JSON."""

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

# Some spreadsheets divide cells at semicolons too; a line that begins with # would be a comment.
_QUOTED = re.compile(r'[",;]|^#')


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """Write rows of texts and numbers under their columns' names; a text as `cell_of` has it."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"{','.join(map(_quoted, cells))}\n" for cells in (columns, *rows))


def _quoted(value: object) -> str:
    cell = cell_of(str(value))
    return '"' + cell.replace('"', '""') + '"' if _QUOTED.search(cell) else cell


def require_new(path: Path) -> None:
    """Refuse to write over a file, as what was filled in would be lost."""
    if path.exists():
        raise InputError(f"{path} is there already; remove it, or give the template another name")


def write_template(path: Path, names: Sequence[str], stamps: Sequence[float]) -> None:
    """Write one row per scan with its name and stamp [s], and all columns of measurements empty, to be filled in."""
    require_new(path)
    empty = [""] * (len(COLUMNS) + len(SIGMA_COLUMNS))
    rows = ([name, f"{stamp:.6f}", *empty] for name, stamp in zip(names, stamps, strict=True))
    write_table(path, ["name", "stamp", *COLUMNS, *SIGMA_COLUMNS], rows)


def write_priors(path: Path, names: Sequence[str], priors: Sequence[PosePrior]) -> None:
    """Write one row per scan, with the columns of what any of them measured; nothing in a cell that one did not."""
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
    """Write a mapping of anything that `to_json` takes as JSON. Every name of a mapping has a line of its own, and so
    has every item of a list that is a list or a mapping itself. Raises TypeError: a value that JSON has no form for;
    InputError: the file cannot be written."""
    text = _in_lines(to_json(content))
    with atomic_path(path) as temporary:
        # A file name that is no UTF-8 holds lone surrogates; written with a backslash they are JSON's own escapes.
        temporary.write_bytes(f"{text}\n".encode("utf-8", "backslashreplace"))


def _in_lines(value: Any, indent: str = "\n") -> str:
    """A value in JSON's types as text; `indent` is a line break and the blanks that its last line begins with."""
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
    """A value in JSON's types: NumPy's, dataclasses, tuples, sets and paths included; NaN and infinity are null. Raises
    TypeError: a value that JSON has no form for."""
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
    raise TypeError(f"a {type(value).__name__} has no form in JSON; give numbers, text, lists or mappings")
