# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Navigation at its own times: what instruments measured between, before or after the scans, at the scans' times."""

from collections.abc import Sequence

import numpy as np

from spectral.scan import PosePrior, Scan
from tools.readers.instruments import prior_of, sigmas_of, values_of
from tools.readers.prior_match import SAME_STAMP

# What is measured at times of its own: columns of a priors file.
_SERIES = (np.array([0, 1]), np.array([2]), np.array([3, 4]), np.array([5]))
_HEADING = 2
# Two measurements this far apart tell what was between them [s].
_MOST_BETWEEN = 5.0
# A single fix is one of the nearest scan, less sure by what a vehicle does in the time between [m/s].
_SPEED = 1.0


def at_scans(scans: Sequence[Scan], times: np.ndarray, priors: Sequence[PosePrior]) -> list[PosePrior | None]:
    """What rows at `times` say of each scan; None where they say nothing.

    Attitude, heading, position and depth may be in rows of their own. Each is interpolated between the measurements
    before and after a scan if these are at most 5 s apart; the larger of both standard deviations counts. A position or
    depth that is farther from the next one belongs to the scan next to it, if that is nearer than half the usual time
    between scans, and is less sure by a meter per second.

    Args:
        scans: with stamps.
        times: (n,) of the rows [s], in any order.
        priors: of the rows.
    """
    order = np.argsort(times, kind="stable")
    times = times[order]
    values = np.array([values_of(priors[k].T_world_sensor) for k in order.tolist()])
    sigmas = np.array([sigmas_of(priors[k]) for k in order.tolist()])
    stamps = np.array([scan.stamp for scan in scans], dtype=np.float64)
    apart = float(np.median(np.diff(np.unique(stamps)))) if len(np.unique(stamps)) > 1 else 0.0
    at, sure = np.full((len(scans), 6), np.nan), np.full((len(scans), 6), np.inf)
    for columns in _SERIES:
        rows = np.flatnonzero(np.isfinite(sigmas[:, columns]).all(axis=1))
        if not len(rows):
            continue
        series = values[np.ix_(rows, columns)]
        if columns[0] == _HEADING:
            series = np.degrees(np.unwrap(np.radians(series), axis=0))
        _interpolate(stamps, times[rows], series, sigmas[np.ix_(rows, columns)], at, sure, columns)
        if columns[0] > _HEADING:
            _attach(stamps, times[rows], series, sigmas[np.ix_(rows, columns)], at, sure, columns, apart / 2)
    known = np.isfinite(at)
    return [prior_of(at[k], sure[k]) if known[k].any() else None for k in range(len(scans))]


def _interpolate(
    stamps: np.ndarray,
    times: np.ndarray,
    series: np.ndarray,
    sigmas: np.ndarray,
    at: np.ndarray,
    sure: np.ndarray,
    columns: np.ndarray,
) -> None:
    """Fill in what lies between two measurements, or at one."""
    after = np.clip(np.searchsorted(times, stamps), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    for near in (before, after):
        same = np.abs(times[near] - stamps) <= SAME_STAMP
        at[np.ix_(same, columns)], sure[np.ix_(same, columns)] = series[near[same]], sigmas[near[same]]
    between = (times[before] < stamps) & (stamps < times[after]) & (times[after] - times[before] <= _MOST_BETWEEN)
    between &= ~np.isfinite(at[:, columns[0]])
    share = ((stamps - times[before]) / np.where(after > before, times[after] - times[before], 1.0))[between, None]
    a, b = before[between], after[between]
    at[np.ix_(between, columns)] = (1 - share) * series[a] + share * series[b]
    sure[np.ix_(between, columns)] = np.maximum(sigmas[a], sigmas[b])


def _attach(
    stamps: np.ndarray,
    times: np.ndarray,
    series: np.ndarray,
    sigmas: np.ndarray,
    at: np.ndarray,
    sure: np.ndarray,
    columns: np.ndarray,
    reach: float,
) -> None:
    """Give single fixes to the scans next to them."""
    for time, value, sigma in zip(times.tolist(), series, sigmas, strict=True):
        k = int(np.argmin(np.abs(stamps - time)))
        if abs(stamps[k] - time) <= reach and not np.isfinite(at[k, columns[0]]):
            at[k, columns], sure[k, columns] = value, np.hypot(sigma, _SPEED * (stamps[k] - time))
