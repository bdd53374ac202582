"""A log of navigation, and which scan a row belongs to: by its name, its stamp, or its number as in pairs.csv."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.readers.csv_table import plain_text
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
    stamp [s, UTC]. Raises InputError: a row that fits several scans or none."""
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
    pairs.csv has it; a name that is a number counts first. Raises InputError: no scan, or several."""
    index = find_scan(scans, "name", cell, float("nan"), where, allow_unknown=True)
    if index is None and cell.isascii() and cell.isdecimal() and len(cell) < 10:
        index = int(cell) if int(cell) < len(scans) else None
    if index is None:
        raise InputError(
            f"{where}: no scan is called {cell[:60]!r}; wanted a name as summary.json lists them, as "
            f"{scans[0].name!r}, or a number from 0 to {len(scans) - 1} as in pairs.csv; fix it or delete the line"
        )
    return index
