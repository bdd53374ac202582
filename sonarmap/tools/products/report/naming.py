# pyright: strict
"""What a survey is called, and when it was taken, as titles say it."""

import glob
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from sonarmap.tools.files.time_scales import are_times, utc_text

_NAMED = 3  # inputs in a title
_DATE = len("2024-05-17")


def inputs_of(settings: Mapping[str, Any]) -> list[str]:
    """Files, folders or patterns, as they were given."""
    given = settings.get("inputs", [])
    return [str(path) for path in (given if isinstance(given, list) else [given])]  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]


def survey_name(inputs: Sequence[str]) -> str:
    """The names of the first files or folders that were given; of a pattern, or of many in one folder, that folder's.
    Empty where there is none."""
    folders = {Path(path).absolute().parent for path in inputs}
    if len(inputs) > _NAMED and len(folders) == 1:
        inputs = [str(*folders)]
    names = list(dict.fromkeys(_name(path) for path in inputs))
    return ", ".join(names[:_NAMED]) + (" and others" if len(names) > _NAMED else "")


def survey_date(stamps: np.ndarray) -> str:
    """The day on which scans with these stamps (n,) [s] were taken, or the first and the last; empty where the stamps
    are no times."""
    if not are_times(stamps):
        return ""
    first, last = (utc_text(float(stamp))[:_DATE] for stamp in (stamps.min(), stamps.max()))
    return first if first == last else f"{first} to {last}"


def plain_text(name: str, longest: int | None = None) -> str:
    """A name as one line of a picture's text: a dollar sign begins no formula, and the middle of a long one is left
    out."""
    name = "".join(c if c.isprintable() else "?" for c in name)
    if longest is not None and len(name) > longest:
        name = f"{name[: longest // 2]}…{name[-((longest - 1) // 2) :]}"
    return name.replace("$", r"\$")


def _name(path: str) -> str:
    pure = PurePath(path)
    if glob.has_magic(pure.name) and pure.parent.name:
        return pure.parent.name
    return pure.name or Path(path).absolute().name or path
