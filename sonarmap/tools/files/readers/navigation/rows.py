"""Numbers, latitudes and longitudes as logs and people write them; and rows of a log that cannot be.

The latter are found by the log alone: places that nobody gets to and back from, values that stand still while the
vehicle moves, times out of order. They are left out, and listed by their lines.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.navigation.log import NavigationLog

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
# What is measured at a time, the columns, and how its steps are read: a place, an angle [deg] or a number.
KINDS = {"position": np.array([3, 4]), "depth": np.array([5]), "heading": np.array([2])}
_FEWEST = 12  # rows of a kind that tell what is usual
# Nothing changes faster than so many times what nearly all steps do (this share of them).
_FASTER, _NEARLY_ALL = 4.0, 0.95
# Rows between two such leaps are wrong if they are fewer than this share of all.
_FEW = 0.1
# A value that repeats itself so often, for so long [s], and so many times longer than repeated values usually do,
# stands still; the vehicle moves meanwhile, by so many times what its steps usually are.
_REPEATED, _STILL, _LONGER, _MOVED = 5, 5.0, 4.0, 10.0


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
    return InputError(f"{where}: {heading} is {cell[:40]!r}; wanted {wanted}; fix that line")


def number_within(where: str, name: str, cell: str, bounds: tuple[float, float], wanted: str) -> float:
    """The number of a cell. Raises InputError: it is none, or not within the bounds."""
    value = number(cell)
    if not bounds[0] <= value <= bounds[1]:
        raise refuse(where, name, cell, wanted)
    return value


@dataclass(frozen=True, slots=True)
class RowFault:
    """A row, or what it measured of a kind, that was left out."""

    line: int  # in the file
    kind: str  # of KINDS, or "time"
    reason: str  # in words


def usable_rows(log: NavigationLog, fastest: float = np.inf) -> tuple[NavigationLog, list[RowFault]]:
    """The log without what cannot be, and that, in the order of its lines; a log whose rows have names is left alone.

    Args:
        log: rows at times of their own.
        fastest: that the vehicle goes [m/s].
    """
    if log.key != "stamp" or len(log.times) < _FEWEST:
        return log, []
    values, faults = log.values.copy(), list[RowFault]()
    for row in _out_of_order(log.times):
        faults.append(RowFault(int(log.lines[row]), "time", "its time is out of order"))
        values[row] = np.nan
    for kind, columns in KINDS.items():
        rows = np.flatnonzero(np.isfinite(values[:, columns]).all(axis=1))
        rows = rows[np.argsort(log.times[rows], kind="stable")]
        rows = rows[np.append(True, np.diff(log.times[rows]) > 0)] if len(rows) else rows
        if len(rows) < _FEWEST:
            continue
        series = values[np.ix_(rows, columns)]
        if kind == "heading":
            series = np.degrees(np.unwrap(np.radians(series), axis=0))
        stated = log.sigmas[np.ix_(rows, columns)]
        noise = float(np.median(stated)) if kind == "position" and np.isfinite(stated).all() else 0.0
        most = (fastest, noise) if kind == "position" else (np.inf, 0.0)
        # a value that stood still leaps when it goes on: first without those
        for found in (_standing, partial(_leaps, fastest=most[0], noise=most[1])):
            left = np.isfinite(values[np.ix_(rows, columns)]).all(axis=1)
            for n, reason in found(log.times[rows[left]], series[left]):
                row = int(rows[left][n])
                faults.append(RowFault(int(log.lines[row]), kind, reason))
                values[row, columns] = np.nan
    return replace(log, values=values), sorted(faults, key=lambda fault: fault.line)


def fault_notes(faults: Sequence[RowFault], listed: int = 5) -> list[str]:
    """The rows in a sentence for each kind and reason."""
    lines: dict[tuple[str, str], list[int]] = {}
    for fault in faults:
        lines.setdefault((fault.kind, fault.reason), []).append(fault.line)
    notes = list[str]()
    for (kind, reason), those in lines.items():
        more = f" and {len(those) - listed} more" if len(those) > listed else ""
        where = f"line{'s' if len(those) > 1 else ''} {', '.join(map(str, those[:listed]))}{more}"
        what = "rows are" if kind == "time" else f"{kind}s are" if len(those) > 1 else f"{kind} is"
        notes.append(f"{len(those)} {what} left out ({where}): {reason}")
    return notes


def _out_of_order(times: np.ndarray) -> list[int]:
    """Rows whose time is not between those of the rows around, which are in order."""
    before, own, behind = times[:-2], times[1:-1], times[2:]
    return (1 + np.flatnonzero((before <= behind) & ((own < before) | (own > behind)))).tolist()


def _leaps(times: np.ndarray, series: np.ndarray, fastest: float, noise: float) -> list[tuple[int, str]]:
    """Rows to which, and back from which, nothing gets so fast."""
    spans = np.diff(times)
    steps = np.linalg.norm(np.diff(series, axis=0), axis=1)
    usual = float(np.quantile(steps / spans, _NEARLY_ALL))
    # what noise alone makes of a step
    most = np.minimum(_FASTER * usual, fastest + 4 * np.sqrt(2) * noise / spans)
    cuts = np.flatnonzero(steps > most * spans)
    if not len(cuts) or usual <= 0:
        return []
    pieces = np.split(np.arange(len(times)), cuts + 1)
    long = [len(piece) >= max(2.0, _FEW * len(times)) for piece in pieces]

    def reaches(a: int, b: int) -> bool:
        return float(np.linalg.norm(series[b] - series[a])) <= most.min() * (times[b] - times[a])

    found, before = list[int](), -1  # before: the last row that is right; -1 while none is known
    for n, piece in enumerate(pieces):
        behind = next((int(pieces[k][0]) for k in range(n + 1, len(pieces)) if long[k]), -1)
        first, last = int(piece[0]), int(piece[-1])
        if long[n] or (before >= 0 and behind >= 0 and reaches(before, first) and reaches(last, behind)):
            before = last
        elif before >= 0 and behind >= 0 and reaches(before, behind):
            found += piece.tolist()
    return [(k, "far from the rows around, farther than the vehicle gets in the time between") for k in found]


def _standing(times: np.ndarray, series: np.ndarray) -> list[tuple[int, str]]:
    """Rows that repeat an earlier value for long, where the next one is far from it."""
    starts = np.flatnonzero(np.append(True, (np.diff(series, axis=0) != 0).any(axis=1)))
    lengths = np.diff(np.append(starts, len(times)))
    steps = np.linalg.norm(np.diff(series[starts], axis=0), axis=1)
    if len(starts) < _FEWEST:
        return []
    usual, moved = np.median(lengths), np.median(steps)
    if series.shape[1] == 1 and moved <= 2 * steps.min():
        return []  # whole degrees or decimeters: they stay the same while a vehicle holds its heading or depth
    found = list[int]()
    for start, length, step in zip(starts[:-1].tolist(), lengths[:-1].tolist(), steps.tolist(), strict=True):
        lasts = times[start + length - 1] - times[start]
        if length >= max(_REPEATED, _LONGER * usual) and lasts >= _STILL and step > _MOVED * moved:
            found += range(start + 1, start + length)
    return [(k, "the same as the rows before, while the vehicle moved on") for k in found]
