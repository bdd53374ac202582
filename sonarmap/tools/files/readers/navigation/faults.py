"""Rows of a navigation log that cannot be right, recognized by the log alone, and left out with their line numbers.

Impossible constants, as -9999, come first: they may be in half of the rows. Then jumps: between two rows a vehicle
moves about as fast as it usually does around them. A log is divided where it moves faster, and the pieces that are kept
are a chain that the vehicle could pass through, with the fewest rows left out.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

from sonarmap.tools.files.readers.instruments import LARGEST, MIN_ROWS
from sonarmap.tools.files.readers.navigation.log import NavigationLog, RowFault
from sonarmap.tools.files.time_scales import YEAR, by_clock, years_apart

# Kinds of measurements: their columns, a speed that is never a jump, and the coarsest resolution [m or degrees, s]
_KINDS = {
    "position": (np.array([3, 4]), 1.0, 1.0),
    "depth": (np.array([5]), 0.5, 1.0),
    "heading": (np.array([2]), 60.0, 5.0),
    "attitude": (np.array([0, 1]), 20.0, 5.0),
}
_MOST_HELD = 20  # rows in which a logger repeats a measurement
_FINEST = 0.1  # quantile of the steps, of which two are the resolution
_CANDIDATES = 8  # most distant and most frequent values that may be impossible constants
_FARTHER = 25.0  # times the usual distance of other values from their running median is an impossible step
_ALONE = 8.0  # times the 75 % quantile of the speed to the nearer neighbor: alone
_USUAL_QUANTILE = 0.95  # of the steps' speeds, is the usual speed
_WINDOW = 21  # steps, of which the median is the usual speed there
_FASTER = 4.0  # times the usual speed is a jump
_FEW, _MOST_FEW = 0.1, 30  # share of all rows, and number of rows between two jumps, that may be wrong
_LOOK_BACK = 1000  # pieces that are left out in a row at most
_TOO_FAR = "far from the rows around, farther than the vehicle gets in the time between"


def usable_rows(
    log: NavigationLog, fastest: float = np.inf, stamps: np.ndarray | None = None
) -> tuple[NavigationLog, list[RowFault]]:
    """The log without faulty measurements, and these, ordered by line; a log whose rows have names is not changed.

    Args:
        log: rows with times.
        fastest: largest speed of the vehicle [m/s].
        stamps: (N,) stamps of the scans, by which one of two clocks is chosen; None if there are none.
    """
    faults = list(log.faults)
    if log.key != "stamp" or len(log.times) < MIN_ROWS:
        return log, faults
    values = log.values.copy()
    for row, reason in _wrong_times(log.times, np.zeros(0) if stamps is None else stamps):
        faults.append(RowFault(int(log.lines[row]), "time", reason))
        values[row] = np.nan
    for kind, (columns, slow, coarse) in _KINDS.items():
        rows = np.flatnonzero(np.isfinite(values[:, columns]).all(axis=1))
        rows = rows[np.argsort(log.times[rows], kind="stable")]
        if len(rows) < MIN_ROWS:
            continue
        period = 360.0 if kind == "heading" else 4 * LARGEST
        each = [_constants(log.times[rows], values[rows, k], slow, coarse, period) for k in columns.tolist()]
        impossible = np.any(each, axis=0)
        faults += _named(log, kind, columns, rows[impossible])
        values[np.ix_(rows[impossible], columns)] = np.nan
        rows = rows[~impossible]
        series = values[np.ix_(rows, columns)]
        if kind == "heading":
            series = np.degrees(np.unwrap(np.radians(series), axis=0))
        stated = log.sigmas[np.ix_(rows, columns)]
        noise = float(np.median(stated)) if np.isfinite(stated).all() else 0.0
        most = (fastest, noise) if kind == "position" else (np.inf, 0.0)
        wrong = rows[_leaps(log.times[rows], series, slow, coarse, *most)]
        faults += _named(log, kind, columns, wrong)
        values[np.ix_(wrong, columns)] = np.nan
    return replace(log, values=values), sorted(dict.fromkeys(faults), key=lambda fault: fault.line)


def _named(log: NavigationLog, kind: str, columns: np.ndarray, rows: np.ndarray) -> list[RowFault]:
    """The faults of rows; those with a repeated value name it."""
    texts = [", ".join(log.text(row, k) for k in columns.tolist()) for row in rows.tolist()]
    reasons = {text: f"{text}, {_TOO_FAR}" if count > 1 else _TOO_FAR for text, count in Counter(texts).items()}
    return [RowFault(line, kind, reasons[text]) for line, text in zip(log.lines[rows].tolist(), texts, strict=True)]


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


def _wrong_times(times: np.ndarray, stamps: np.ndarray) -> list[tuple[int, str]]:
    """Rows of another clock, years from the others, and rows whose time is not between those of their neighbors,
    although these are in order."""
    clocks, middle = by_clock(times), float(np.median(stamps)) if len(stamps) else np.nan
    kept = max(clocks, key=lambda rows: (abs(times[rows[0]] - middle) < YEAR, len(rows)))
    wrong = list[tuple[int, str]]()
    for rows in clocks:
        if rows is not kept:
            reason = f"the time is {years_apart(times[rows], times[kept])} that of the other rows"
            wrong += [(row, reason) for row in rows.tolist()]
    rows = np.sort(kept)
    before, own, behind = times[rows[:-2]], times[rows[1:-1]], times[rows[2:]]
    misplaced = rows[1:-1][(before <= behind) & ((own < before) | (own > behind))]
    return wrong + [(row, "its time is out of order") for row in misplaced.tolist()]


@dataclass(frozen=True, slots=True)
class _Sampling:
    """How a logger samples a measurement."""

    usual: float  # time between rows [s]; shorter ones are those of messages that were sent together
    held: float  # time for which a measurement is repeated [s]
    grain: float  # length of a step that the resolution causes

    @classmethod
    def of(cls, times: np.ndarray, series: np.ndarray, coarse: float) -> "_Sampling":
        steps = np.linalg.norm(np.diff(series, axis=0), axis=1)
        rows = float(np.median(np.diff(np.flatnonzero(np.concatenate([[True], steps > 0, [True]])))))
        usual = float(np.median(np.diff(times)) or np.ptp(times) / len(times)) or 1.0
        finest = np.quantile(steps[steps > 0], _FINEST) if steps.any() else 0.0
        return cls(usual, (rows - 1) * usual if rows <= _MOST_HELD else 0.0, 2 * min(float(finest), coarse))

    def spans(self, between: np.ndarray) -> np.ndarray:
        """The times [s] in which a vehicle moved between rows that are `between` apart [s]."""
        return np.maximum(between, self.usual) + self.held


def _constants(times: np.ndarray, column: np.ndarray, slow: float, coarse: float, period: float) -> np.ndarray:
    """(n,) bool: rows of `column` (n,) with a value that no instrument measured, as -9999: it repeats, and most of its
    runs are far from the rows of other values before and behind them. It may be in half of the rows."""
    wrong, sampling = np.zeros(len(column), bool), _Sampling.of(times, column[:, None], coarse)
    values, counts = np.unique(column, return_counts=True)
    values, counts = values[counts > 1], counts[counts > 1]
    frequent = values[np.argsort(-counts, kind="stable")]
    distant = values[np.argsort(-np.abs(values - np.median(column)), kind="stable")]
    for value in dict.fromkeys([*distant[:_CANDIDATES].tolist(), *frequent[:_CANDIDATES].tolist()]):
        own, others = np.flatnonzero((column == value) & ~wrong), np.flatnonzero((column != value) & ~wrong)
        if len(others) < max(len(column) / 2, MIN_ROWS):
            continue
        # runs are divided by rows of other values; `behind` are the first of these after each run
        behind, first, run = np.unique(np.searchsorted(others, own), return_index=True, return_inverse=True)
        last = np.append(first[1:], len(own)) - 1
        jumps = np.full((2, len(first)), np.nan)
        for side, (place, end) in enumerate(((behind - 1, own[first]), (behind, own[last]))):
            there = (place >= 0) & (place < len(others))
            rows = others[place[there]]
            ways = np.abs((column[rows] - value + period / 2) % period - period / 2) - sampling.grain
            jumps[side, there] = ways - slow * sampling.spans(np.abs(times[rows] - times[end[there]]))
        jump, rest = np.fmin(*jumps), column[others]  # to the nearer neighbor
        spread = 0.0
        if (jump > 0).any() and np.abs(rest - value).min() <= np.ptp(rest):
            off = np.abs(rest - median_filter(rest, _WINDOW))
            spread = np.median(off[off > 0]) if off.any() else 0.0
        far = jump > _FARTHER * spread
        if far.mean() > 0.5:
            wrong[own[far[run]]] = True
    return wrong


def _leaps(
    times: np.ndarray, series: np.ndarray, slow: float, coarse: float, fastest: float, noise: float
) -> np.ndarray:
    """(n,) bool: rows that the vehicle could not reach and return from in the time between rows."""
    sampling = _Sampling.of(times, series, coarse)
    spans = sampling.spans(np.diff(times))
    speeds = np.linalg.norm(np.diff(series, axis=0), axis=1) / spans
    alone = np.minimum(np.append(np.inf, speeds), np.append(speeds, np.inf))  # to the nearer of both neighbors
    calm = np.flatnonzero(alone <= max(_ALONE * float(np.quantile(alone, 0.75)), slow))
    steady = np.linalg.norm(np.diff(series[calm], axis=0), axis=1) / sampling.spans(np.diff(times[calm]))
    usual = np.maximum(np.quantile(steady, _USUAL_QUANTILE), median_filter(speeds, _WINDOW, mode="mirror"))
    # the noise of two fixes adds to their step
    most = np.minimum(np.maximum(_FASTER * usual, slow), fastest + 4 * np.sqrt(2) * noise / spans)
    first = np.append(0, 1 + np.flatnonzero(speeds > most + sampling.grain / spans))
    kept = _chain(times, series, first, np.append(most, most[-1:]), sampling)
    return np.repeat(~kept, np.diff(np.append(first, len(times))))


def _chain(
    times: np.ndarray, series: np.ndarray, first: np.ndarray, most: np.ndarray, sampling: _Sampling
) -> np.ndarray:
    """(P,) bool: pieces of a series, which begin at the rows `first`, to keep. Pieces in between are left out only if
    the vehicle gets from the one before to the one behind at the speeds `most` (n,). Each row that is left out costs 1,
    and each jump between neighboring pieces half of the longest run that may be left out."""
    last = np.append(first[1:], len(times)) - 1
    jump = max(1.0, min(_FEW * len(times), _MOST_FEW) / 2)
    before, cost = np.full(len(first), -1), np.zeros(len(first))
    for p in range(1, len(first)):
        q = np.arange(max(0, p - _LOOK_BACK), p)
        ways = np.linalg.norm(series[first[p]] - series[last[q]], axis=1) - sampling.grain
        reached = ways <= np.minimum(most[last[q]], most[first[p]]) * sampling.spans(times[first[p]] - times[last[q]])
        costs = np.where(reached, cost[q] + first[p] - last[q] - 1, np.inf)
        costs[-1] = cost[p - 1] + jump
        before[p], cost[p] = q[np.argmin(costs)], costs.min()
        if first[p] == 1 and cost[p] > 1:  # the first row alone
            before[p], cost[p] = -1, 1.0
    kept, p = np.zeros(len(first), bool), len(first) - 1
    if p > 0 and first[p] == last[p] and cost[p] > cost[p - 1] + 1:  # the last row alone
        p -= 1
    while p >= 0:
        kept[p], p = True, int(before[p])
    return kept
