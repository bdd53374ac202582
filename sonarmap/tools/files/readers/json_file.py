"""Files of JSON, whatever they hold."""

import json
import math
from pathlib import Path
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.user_file import read_content

_LARGEST = 1e30  # of a number: as large as an information, see `tools.files.readers.limits`
_LARGEST_INTEGER = 2**63 - 1


def read_json(path: Path, expected: str) -> Any:
    """What the file, which should be what is `expected`, holds. Raises InputError: it cannot be read, is no JSON in
    UTF-8, is nested too deeply, or holds NaN, Infinity or a number beyond 1e30 (a whole one: 2^63)."""
    try:
        text = read_content(Path(path), pipe=True).decode("utf-8")
        return json.loads(text, parse_float=_number, parse_int=_integer, parse_constant=_no_number)
    except InputError as error:
        raise InputError(f"{error}; expected {expected}") from error
    except ValueError as error:
        reason = str(error)
    except RecursionError:
        reason = "it is nested too deeply"
    raise InputError(f"cannot read {path}: {reason}; expected {expected}")


def _number(text: str) -> float:
    number = float(text)
    return number if math.fabs(number) <= _LARGEST else _no_number(text)


def _integer(text: str) -> int:
    return int(text) if len(text) <= 20 and abs(int(text)) <= _LARGEST_INTEGER else _no_number(text)


def _no_number(text: str) -> Any:
    raise ValueError(f"it holds the number {text[:40]}, which is too large or none at all")
