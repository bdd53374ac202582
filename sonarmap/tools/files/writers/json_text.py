"""Values of any kind as JSON, and a file of them."""

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.files.writers.atomic import atomic_path


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
