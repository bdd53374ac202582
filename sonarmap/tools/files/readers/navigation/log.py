"""Navigation logs: interpolation at the scans' stamps, and scans by name, stamp or number."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.csv_table import index_of, plain_text
from sonarmap.tools.files.readers.file import FORMATS
from sonarmap.tools.files.readers.instruments import COLUMNS, MIN_ROWS

# Columns that are measured together, at times of their own.
SERIES = (np.array([0, 1]), np.array([2]), np.array([3, 4]), np.array([5]))
_HEADING = 2
MOST_BETWEEN = 5.0  # [s], longest gap between two measurements that is interpolated
_SPEED = 1.0  # [m/s] of the vehicle, for the error of a fix that is assigned to the nearest scan
SAME_STAMP = 1e-3  # [s]: files round stamps to different numbers of digits
_LEAST_APART = 1.0  # [m] between two receivers
_STEADIER = 4.0  # times nearer to every second position than to the next: two receivers
_SUFFIX = re.compile(rf"(.+)({'|'.join(map(re.escape, FORMATS))})(#\d+)?", re.IGNORECASE | re.DOTALL)


@dataclass(frozen=True, slots=True)
class RowFault:
    """A measurement, or a whole row, that was left out."""

    line: int  # in the file
    kind: str  # of measurements, or "time"
    reason: str  # in words


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
    faults: tuple[RowFault, ...] = ()  # measurements that were left out when it was read
    # {column of COLUMNS: what the file has in the rows}
    cells: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def text(self, row: int, column: int) -> str:
        """A value as the file has it."""
        cells = self.cells.get(COLUMNS[column])
        return cells[row] if cells is not None else f"{self.values[row, column]:g}"

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
    for columns in SERIES:
        rows = np.flatnonzero(np.isfinite(values[:, columns]).all(axis=1))
        if not len(rows):
            continue
        series, is_angle = values[np.ix_(rows, columns)], columns[0] <= _HEADING
        if is_angle:
            series = np.degrees(np.unwrap(np.radians(series), axis=0))
        reach = SAME_STAMP if is_angle else max(apart / 2, SAME_STAMP)
        measured = times[rows], series, sigmas[np.ix_(rows, columns)]
        known[:, columns], deviations[:, columns] = _interpolated(stamps, *measured, reach)
    return known, deviations


def _interpolated(
    stamps: np.ndarray, times: np.ndarray, values: np.ndarray, sigmas: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """(N, m) values at a measurement, between two, or of the nearest within `reach` [s]; NaN where unknown; and
    standard deviations, inf there."""
    known, deviations = (np.full((len(stamps), values.shape[1]), unknown) for unknown in (np.nan, np.inf))
    b = np.clip(np.searchsorted(times, stamps), 0, len(times) - 1)
    a = np.maximum(b - 1, 0)
    nearest = np.where(np.abs(times[a] - stamps) < np.abs(times[b] - stamps), a, b)
    away = np.abs(times[nearest] - stamps)
    near = away <= reach
    known[near] = values[nearest[near]]
    deviations[near] = np.hypot(sigmas[nearest[near]], (_SPEED * np.where(away > SAME_STAMP, away, 0.0))[near, None])
    between = (away > SAME_STAMP) & (times[a] < stamps) & (stamps < times[b]) & (times[b] - times[a] <= MOST_BETWEEN)
    a, b = a[between], b[between]
    share = ((stamps[between] - times[a]) / (times[b] - times[a]))[:, None]
    known[between] = (1 - share) * values[a] + share * values[b]
    deviations[between] = np.maximum(sigmas[a], sigmas[b])
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


def refuse_alternating(
    path: Path, times: np.ndarray, places: np.ndarray, lines: np.ndarray, least: float = _LEAST_APART
) -> None:
    """Raise InputError if positions (n, 2) [m], NaN where not measured, alternate between those of two receivers, which
    are at least `least` apart [m]."""
    rows = np.flatnonzero(np.isfinite(places).all(axis=1) & np.isfinite(times))
    rows = rows[np.argsort(times[rows], kind="stable")]
    if len(rows) < MIN_ROWS:
        return
    own, places = times[rows], places[rows]
    offs = list[float]()
    for lag in (1, 2):  # from the way between the positions before and behind, of the other or the same receiver
        span = own[2 * lag :] - own[: -2 * lag]
        share = np.where(span > 0, (own[lag:-lag] - own[: -2 * lag]) / np.where(span > 0, span, 1.0), 0.5)[:, None]
        between = (1 - share) * places[: -2 * lag] + share * places[2 * lag :]
        offs.append(float(np.median(np.linalg.norm(places[lag:-lag] - between, axis=1))))
    next_off, second_off = offs
    if next_off > max(least, _STEADIER * second_off):
        raise InputError(
            f"{path}: its positions alternate between two places {next_off:.1f} m apart, as those of two receivers do; "
            f"delete those of one, in lines {', '.join(map(str, lines[rows[1:6:2]]))} and so on, or choose one of two "
            "talkers by --nmea-talker"
        )
