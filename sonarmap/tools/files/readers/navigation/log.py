"""Navigation logs: interpolation at the scans' stamps, scans by name, stamp or number, and detection of faulty rows.

Faulty rows are recognized by the log alone: positions too far away to reach and return from in time, and times out of
order. They are left out, and listed by their line numbers.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.csv_table import index_of, plain_text
from sonarmap.tools.files.readers.file import FORMATS

# Columns that are measured together, at times of their own.
_SERIES = (np.array([0, 1]), np.array([2]), np.array([3, 4]), np.array([5]))
_HEADING = 2
MOST_BETWEEN = 5.0  # [s], longest gap between two measurements that is interpolated
_SPEED = 1.0  # [m/s] of the vehicle, for the error of a fix that is assigned to the nearest scan
SAME_STAMP = 1e-3  # [s]: files round stamps to different numbers of digits
_SUFFIX = re.compile(rf"(.+)({'|'.join(map(re.escape, FORMATS))})(#\d+)?", re.IGNORECASE | re.DOTALL)
# Kinds of measurements that are searched for faulty rows, and their columns.
KINDS = {"position": np.array([3, 4]), "depth": np.array([5]), "heading": np.array([2])}
_MIN_ROWS = 12  # of a kind, for its usual steps to be known
_USUAL_QUANTILE = 0.95  # of the steps' speeds, is the usual speed
_FASTER = 4.0  # times the usual speed is a jump
_FEW = 0.1  # rows between two leaps are wrong if they are fewer than this share of all
_TOO_FAR = "far from the rows around, farther than the vehicle gets in the time between"


@dataclass(frozen=True, slots=True)
class NavigationLog:
    """Rows of a navigation file, for the vehicle, or for the sonar if no mount is given."""

    key: str  # "name" or "stamp": the column that tells which scan a row is for
    lines: np.ndarray  # (n,) int64 line numbers of the rows
    keys: tuple[str, ...]  # the scans' names, or the stamps as text
    times: np.ndarray  # (n,) float64 [s, UTC]; NaN where the key is a name
    # (n, 6) float64 in the order, units and signs of `readers.instruments.COLUMNS`; NaN where not measured. x and y
    # are East and North of the georeference's origin, if there is one; headings count from the settings' North.
    values: np.ndarray
    sigmas: np.ndarray  # (n, 6) float64 standard deviations in the same units; NaN where the file has none
    georeference: Georeference | None = None  # where the origin is on the Earth; None if unknown

    @property
    def measured(self) -> np.ndarray:
        """(n,) bool: rows in which anything was measured."""
        return np.any(np.isfinite(self.values), axis=1)


def at_scans(
    stamps: np.ndarray, times: np.ndarray, values: np.ndarray, sigmas: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate rows at `times` (n,) [s], in any order, with `values` and `sigmas` (n, 6), to N scans at `stamps`.

    Attitude, heading, position and depth may be in separate rows. Each is interpolated between the measurements before
    and after a scan if these are at most 5 s apart, with the larger of both standard deviations. A scan without such a
    position or depth takes the nearest one within half the usual time between scans; its error grows by 1 m/s.

    Returns: (N, 6) values in the order and units of COLUMNS, NaN where unknown, and standard deviations, inf there.
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
    """(N, m) values between two measurements or at one, NaN where unknown, and standard deviations, inf there."""
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
    """Assign each measurement to the nearest scan within `reach` [s], and keep the nearest one of each scan; the result
    is that of `_interpolated`."""
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
    """The index of the scan with a row's name or stamp; None if there is none and `allow_unknown`. `by` is "name" or
    "stamp"; `key` is the row's name (with or without the suffix of the scan's file, as `recording.sonar#3`) or stamp as
    text, `time` its stamp [s, UTC]."""
    indices = [k for k, scan in enumerate(scans) if abs(scan.stamp - time) <= SAME_STAMP]
    if by == "name":
        match = _SUFFIX.fullmatch(key)
        bare = match[1] + (match[3] or "") if match else key
        indices = _called(scans, key) or _called(scans, bare)
    if len(indices) > 1:
        both = " and ".join(scans[index].name for index in indices[:2])
        raise InputError(f"{where}: the {by} {key!r} fits {len(indices)} scans, among them {both}; rename their files")
    if not indices and not allow_unknown:
        raise InputError(
            f"{where}: no scan has the {by} {key!r}; the first scan is called {scans[0].name!r} and has the stamp "
            f"{scans[0].stamp!r}. Fix the {by} or delete the line"
        )
    return indices[0] if indices else None


def _called(scans: Sequence[Scan], name: str) -> list[int]:
    """The scans with a name, as it is or as tables write it: without line breaks and the like."""

    def fits(own: str) -> bool:
        return own == name or ((not own.isprintable() or own != own.strip()) and plain_text(own) == name)

    return [index for index, scan in enumerate(scans) if fits(scan.name)]


def named_scan(scans: Sequence[Scan], cell: str, where: str) -> int:
    """The index of a scan. `cell`: the scan's name, with or without the suffix of its file, or its number from 0 as in
    pairs.csv; a name takes precedence over a number."""
    index = find_scan(scans, "name", cell, float("nan"), where, allow_unknown=True)
    if index is None and (index := index_of(cell, len(scans))) is None:
        raise InputError(
            f"{where}: no scan is called {cell[:60]!r}; wanted names as {scans[0].name!r}, or 0 to {len(scans) - 1}"
        )
    return index


@dataclass(frozen=True, slots=True)
class RowFault:
    """A measurement, or a whole row, that was left out."""

    line: int  # in the file
    kind: str  # of KINDS, or "time"
    reason: str  # in words


def usable_rows(log: NavigationLog, fastest: float = np.inf) -> tuple[NavigationLog, list[RowFault]]:
    """The log without faulty measurements, and these, ordered by line; a log whose rows have names is not changed.

    Args:
        log: rows with times.
        fastest: largest speed of the vehicle [m/s].
    """
    if log.key != "stamp" or len(log.times) < _MIN_ROWS:
        return log, []
    values, faults = log.values.copy(), list[RowFault]()
    for row in _out_of_order(log.times):
        faults.append(RowFault(int(log.lines[row]), "time", "its time is out of order"))
        values[row] = np.nan
    for kind, columns in KINDS.items():
        rows = np.flatnonzero(np.isfinite(values[:, columns]).all(axis=1))
        rows = rows[np.argsort(log.times[rows], kind="stable")]
        rows = rows[np.append(True, np.diff(log.times[rows]) > 0)] if len(rows) else rows
        if len(rows) < _MIN_ROWS:
            continue
        series = values[np.ix_(rows, columns)]
        if kind == "heading":
            series = np.degrees(np.unwrap(np.radians(series), axis=0))
        stated = log.sigmas[np.ix_(rows, columns)]
        noise = float(np.median(stated)) if kind == "position" and np.isfinite(stated).all() else 0.0
        most = (fastest, noise) if kind == "position" else (np.inf, 0.0)
        for row in rows[_leaps(log.times[rows], series, *most)].tolist():
            faults.append(RowFault(int(log.lines[row]), kind, _TOO_FAR))
            values[row, columns] = np.nan
    return replace(log, values=values), sorted(faults, key=lambda fault: fault.line)


def fault_notes(faults: Sequence[RowFault], listed: int = 5) -> list[str]:
    """One sentence for each kind and reason, with the line numbers of the rows, at most `listed`."""
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
    """Rows whose time is not between those of their neighbors, although these are in order."""
    before, own, behind = times[:-2], times[1:-1], times[2:]
    return (1 + np.flatnonzero((before <= behind) & ((own < before) | (own > behind)))).tolist()


def _leaps(times: np.ndarray, series: np.ndarray, fastest: float, noise: float) -> list[int]:
    """Rows that the vehicle could not reach and return from in the time between rows."""
    spans = np.diff(times)
    steps = np.linalg.norm(np.diff(series, axis=0), axis=1)
    usual = float(np.quantile(steps / spans, _USUAL_QUANTILE))
    # the noise of two fixes adds to their step
    most = np.minimum(_FASTER * usual, fastest + 4 * np.sqrt(2) * noise / spans)
    cuts = np.flatnonzero(steps > most * spans)
    if not len(cuts) or usual <= 0:
        return []
    pieces = np.split(np.arange(len(times)), cuts + 1)
    long = [len(piece) >= max(2.0, _FEW * len(times)) for piece in pieces]

    def reaches(a: int, b: int) -> bool:
        return float(np.linalg.norm(series[b] - series[a])) <= most.min() * (times[b] - times[a])

    faulty, before = list[int](), -1  # before: the last good row; -1 while there is none
    for n, piece in enumerate(pieces):
        behind = next((int(pieces[k][0]) for k in range(n + 1, len(pieces)) if long[k]), -1)
        first, last = int(piece[0]), int(piece[-1])
        if long[n] or (before >= 0 and behind >= 0 and reaches(before, first) and reaches(last, behind)):
            before = last
        elif before >= 0 and behind >= 0 and reaches(before, behind):
            faulty += piece.tolist()
    return faulty
