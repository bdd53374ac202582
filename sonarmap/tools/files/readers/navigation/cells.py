"""Numbers, latitudes and longitudes as logs and people write them."""

import re
from collections.abc import Sequence

import numpy as np

from sonarmap.kernels.errors import InputError

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
    """The error of a cell that cannot be used."""
    return InputError(f"{where}: {heading} is {cell[:40]!r}; wanted {wanted}; fix that line")


def number_within(where: str, name: str, cell: str, bounds: tuple[float, float], wanted: str) -> float:
    """The number of a cell. Raises InputError: it is none, or not within the bounds."""
    value = number(cell)
    if not bounds[0] <= value <= bounds[1]:
        raise refuse(where, name, cell, wanted)
    return value
