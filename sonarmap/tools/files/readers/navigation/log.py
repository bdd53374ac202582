"""Navigation as a file has it, rows of measurements at names or times, and what these say at the scans' times."""

from dataclasses import dataclass

import numpy as np

from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.readers.navigation.match import SAME_STAMP

# What is measured at times of its own: columns of a priors file.
_SERIES = (np.array([0, 1]), np.array([2]), np.array([3, 4]), np.array([5]))
_HEADING = 2
# Two measurements this far apart tell what was between them [s].
MOST_BETWEEN = 5.0
# A single fix is one of the nearest scan, less sure by what a vehicle does in the time between [m/s].
_SPEED = 1.0


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
