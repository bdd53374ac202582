"""Navigation as a file has it, rows of measurements at names or times, and what these say at the scans' times."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.readers.instruments import COLUMNS
from sonarmap.tools.files.readers.navigation.match import SAME_STAMP

# What is measured at times of its own: columns of a priors file.
_SERIES = (np.array([0, 1]), np.array([2]), np.array([3, 4]), np.array([5]))
_HEADING = 2
# Two measurements this far apart tell what was between them [s].
_MOST_BETWEEN = 5.0
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


def with_defaults(sigmas: np.ndarray, defaults: Mapping[str, float]) -> np.ndarray:
    """(n, 6) standard deviations, where there are none those of {column of COLUMNS: standard deviation}."""
    return np.where(np.isnan(sigmas), [defaults.get(column, np.nan) for column in COLUMNS], sigmas)


def at_scans(stamps: np.ndarray, times: np.ndarray, values: np.ndarray, sigmas: np.ndarray) -> "AtScans":
    """What rows at `times` (n,) [s], in any order, say of each scan: `values` (n, 6) in the order and units of
    `tools.files.readers.instruments.COLUMNS`, NaN where not measured, and standard deviations in the same units.

    Attitude, heading, position and depth may be in rows of their own. Each is interpolated between the measurements
    before and after a scan if these are at most 5 s apart; the larger of both standard deviations counts. A position or
    depth that is farther from the next one belongs to the scan next to it, if that is nearer than half the usual time
    between scans, and is less sure by a meter per second.
    """
    order = np.argsort(times, kind="stable")
    times, values, sigmas = times[order], values[order], sigmas[order]
    steps = np.diff(np.unique(stamps))
    apart = float(np.median(steps)) if len(steps) else 0.0
    known = AtScans(stamps, np.full((len(stamps), 6), np.nan), np.full((len(stamps), 6), np.inf))
    for columns in _SERIES:
        rows = np.flatnonzero(np.isfinite(values[:, columns]).all(axis=1))
        if not len(rows):
            continue
        series = values[np.ix_(rows, columns)]
        if columns[0] <= _HEADING:
            series = np.degrees(np.unwrap(np.radians(series), axis=0))
        measured = _Series(columns, times[rows], series, sigmas[np.ix_(rows, columns)])
        known.interpolate(measured)
        if columns[0] > _HEADING:
            known.attach(measured, apart / 2)
    return known


@dataclass(frozen=True, slots=True)
class _Series:
    """What is measured together: (m,) columns, (n,) times [s], (n, m) values and standard deviations."""

    columns: np.ndarray
    times: np.ndarray
    values: np.ndarray
    sigmas: np.ndarray


@dataclass(frozen=True, slots=True)
class AtScans:
    """What is told of N scans so far: (N,) stamps [s], (N, 6) values, NaN where unknown, and standard deviations."""

    stamps: np.ndarray
    values: np.ndarray
    sigmas: np.ndarray

    def interpolate(self, series: _Series) -> None:
        """Fill in what lies between two measurements, or at one."""
        stamps, times, columns = self.stamps, series.times, series.columns
        after = np.clip(np.searchsorted(times, stamps), 0, len(times) - 1)
        before = np.maximum(after - 1, 0)
        for near in (before, after):
            same = np.abs(times[near] - stamps) <= SAME_STAMP
            self.values[np.ix_(same, columns)] = series.values[near[same]]
            self.sigmas[np.ix_(same, columns)] = series.sigmas[near[same]]
        between = (times[before] < stamps) & (stamps < times[after]) & (times[after] - times[before] <= _MOST_BETWEEN)
        between &= ~np.isfinite(self.values[:, columns[0]])
        a, b = before[between], after[between]
        share = ((stamps[between] - times[a]) / (times[b] - times[a]))[:, None]
        self.values[np.ix_(between, columns)] = (1 - share) * series.values[a] + share * series.values[b]
        self.sigmas[np.ix_(between, columns)] = np.maximum(series.sigmas[a], series.sigmas[b])

    def attach(self, series: _Series, reach: float) -> None:
        """Give single fixes to the scans next to them, at most so far away [s]."""
        order = np.argsort(self.stamps, kind="stable")
        sorted_stamps = self.stamps[order]
        after = np.clip(np.searchsorted(sorted_stamps, series.times), 0, len(order) - 1)
        before = np.maximum(after - 1, 0)
        is_before = np.abs(sorted_stamps[before] - series.times) <= np.abs(sorted_stamps[after] - series.times)
        nearest = order[np.where(is_before, before, after)]
        near = np.abs(self.stamps[nearest] - series.times) <= reach
        for row in np.flatnonzero(near).tolist():
            k = nearest[row]
            if not np.isfinite(self.values[k, series.columns[0]]):
                self.values[k, series.columns] = series.values[row]
                away = _SPEED * (self.stamps[k] - series.times[row])
                self.sigmas[k, series.columns] = np.hypot(series.sigmas[row], away)
