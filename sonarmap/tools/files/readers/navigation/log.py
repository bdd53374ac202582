"""A log of navigation, which scan a row belongs to (by its name, its stamp, or its number as in pairs.csv), and rows
that cannot be.

The latter are recognized by the log alone: places that nobody gets to and back from, values that stand still while the
vehicle moves, times out of order. They are left out, and listed by their lines.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.csv_table import index_of, plain_text
from sonarmap.tools.files.readers.file import FORMATS

# What is measured at times of its own: columns of a priors file.
_SERIES = (np.array([0, 1]), np.array([2]), np.array([3, 4]), np.array([5]))
_HEADING = 2
# Two measurements this far apart tell what was between them [s].
MOST_BETWEEN = 5.0
# A single fix is one of the nearest scan, less sure by what a vehicle does in the time between [m/s].
_SPEED = 1.0
SAME_STAMP = 1e-3  # seconds: files carry stamps with other numbers of digits
_SUFFIX = re.compile(rf"(.+)({'|'.join(map(re.escape, FORMATS))})(#\d+)?", re.IGNORECASE | re.DOTALL)
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


@dataclass(frozen=True, slots=True)
class NavigationLog:
    """Rows of a file of navigation, of the vehicle, or of the sonar where nothing is said of its mount."""

    key: str  # "name" or "stamp", which says which scan a row is for
    lines: np.ndarray  # (n,) int64, of the rows in the file
    keys: tuple[str, ...]  # the names, or the stamps as they are written
    times: np.ndarray  # (n,) float64 [s, UTC]; NaN where the key is a name
    # (n, 6) float64 in the order, units and signs of `readers.instruments.COLUMNS`; NaN where nothing was measured. x
    # and y are East and North of the georeference's origin, if there is one; headings from the North of
    # `heading_reference`.
    values: np.ndarray
    sigmas: np.ndarray  # (n, 6) float64 standard deviations in the same units; NaN where the file has none
    georeference: Georeference | None = None  # where the origin is on the Earth; None where that is not known

    @property
    def measured(self) -> np.ndarray:
        """(n,) bool: rows in which anything was measured."""
        return np.any(np.isfinite(self.values), axis=1)


def at_scans(
    stamps: np.ndarray, times: np.ndarray, values: np.ndarray, sigmas: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What rows at `times` (n,) [s], in any order, say of scans at (N,) stamps: (N, 6) values in the order and units of
    COLUMNS, NaN where unknown, and standard deviations, inf there, of `values` and `sigmas` (n, 6) alike.

    Attitude, heading, position and depth may be in rows of their own. Each is interpolated between the measurements
    before and after a scan if these are at most 5 s apart; the larger of both standard deviations counts. A position or
    depth that is farther from the next one belongs to the scan next to it, if that is nearer than half the usual time
    between scans, and is less sure by a meter per second.
    """
    order = np.argsort(times, kind="stable")
    times, values, sigmas = times[order], values[order], sigmas[order]
    steps = np.diff(np.unique(stamps))
    apart = float(np.median(steps)) if len(steps) else 0.0
    known, deviations = np.full((len(stamps), 6), np.nan), np.full((len(stamps), 6), np.inf)
    for columns in _SERIES:
        rows = np.flatnonzero(np.isfinite(values[:, columns]).all(axis=1))
        if not len(rows):
            continue
        series = values[np.ix_(rows, columns)]
        if columns[0] <= _HEADING:
            series = np.degrees(np.unwrap(np.radians(series), axis=0))
        measured = times[rows], series, sigmas[np.ix_(rows, columns)]
        known[:, columns], deviations[:, columns] = _interpolated(stamps, *measured)
        if columns[0] > _HEADING:
            single = np.isnan(known[:, columns[0]])
            fixes = _attached(stamps, *measured, apart / 2)
            known[np.ix_(single, columns)], deviations[np.ix_(single, columns)] = (each[single] for each in fixes)
    return known, deviations


def _interpolated(
    stamps: np.ndarray, times: np.ndarray, values: np.ndarray, sigmas: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What lies between two measurements, or at one: (N, m) values, NaN where unknown, and standard deviations."""
    known, deviations = (np.full((len(stamps), values.shape[1]), unknown) for unknown in (np.nan, np.inf))
    after = np.clip(np.searchsorted(times, stamps), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    for near in (before, after):
        same = np.abs(times[near] - stamps) <= SAME_STAMP
        known[same], deviations[same] = values[near[same]], sigmas[near[same]]
    between = (times[before] < stamps) & (stamps < times[after]) & (times[after] - times[before] <= MOST_BETWEEN)
    between &= np.isnan(known[:, 0])
    a, b = before[between], after[between]
    share = ((stamps[between] - times[a]) / (times[b] - times[a]))[:, None]
    known[between] = (1 - share) * values[a] + share * values[b]
    deviations[between] = np.maximum(sigmas[a], sigmas[b])
    return known, deviations


def _attached(
    stamps: np.ndarray, times: np.ndarray, values: np.ndarray, sigmas: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """For each scan the nearest of the measurements to which it is the nearest scan, at most `reach` [s] away, as
    `_interpolated` gives them."""
    known, deviations = (np.full((len(stamps), values.shape[1]), unknown) for unknown in (np.nan, np.inf))
    order = np.argsort(stamps, kind="stable")
    after = np.clip(np.searchsorted(stamps[order], times), 0, len(order) - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(stamps[order[before]] - times) <= np.abs(stamps[order[after]] - times)
    nearest = order[np.where(is_before, before, after)]
    away = np.abs(stamps[nearest] - times)
    within = np.flatnonzero(away <= reach)[::-1]
    for row in within[np.argsort(-away[within], kind="stable")].tolist():  # the nearest wins, of two the first
        known[nearest[row]] = values[row]
        deviations[nearest[row]] = np.hypot(sigmas[row], _SPEED * away[row])
    return known, deviations


def find_scan(scans: Sequence[Scan], by: str, key: str, time: float, where: str, allow_unknown: bool) -> int | None:
    """The index of the scan with a row's name or stamp; None if there is none and `allow_unknown`. `by` is "name" (with
    or without the suffix of the scan's file, as `recording.sonar#3`) or "stamp"; `key` is what the row has, `time` its
    stamp [s, UTC]."""
    indices = [k for k, scan in enumerate(scans) if abs(scan.stamp - time) <= SAME_STAMP]
    if by == "name":
        match = _SUFFIX.fullmatch(key)
        bare = match[1] + (match[3] or "") if match else key
        indices = _called(scans, key) or _called(scans, bare)
    if len(indices) > 1:
        both = " and ".join(scans[index].name for index in indices[:2])
        raise InputError(
            f"{where}: the {by} {key!r} fits {len(indices)} scans, among them {both}; rename their files, and use "
            "their names"
        )
    if not indices and not allow_unknown:
        raise InputError(
            f"{where}: no scan has the {by} {key!r}; the first scan is called {scans[0].name!r} and has the stamp "
            f"{scans[0].stamp!r}. Fix the {by} or delete the line"
        )
    return indices[0] if indices else None


def _called(scans: Sequence[Scan], name: str) -> list[int]:
    """The scans with a name as a table can have it, which is the scan's own but for line breaks and the like."""

    def fits(own: str) -> bool:
        return own == name or ((not own.isprintable() or own != own.strip()) and plain_text(own) == name)

    return [index for index, scan in enumerate(scans) if fits(scan.name)]


def named_scan(scans: Sequence[Scan], cell: str, where: str) -> int:
    """The index of a scan. `cell`: a scan's name, with or without the suffix of its file, or its number from 0 as
    pairs.csv has it; a name that is a number counts first."""
    index = find_scan(scans, "name", cell, float("nan"), where, allow_unknown=True)
    if index is None and (index := index_of(cell, len(scans))) is None:
        raise InputError(
            f"{where}: no scan is called {cell[:60]!r}; wanted a name as summary.json lists them, as "
            f"{scans[0].name!r}, or a number from 0 to {len(scans) - 1} as in pairs.csv; fix it or delete the line"
        )
    return index


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
