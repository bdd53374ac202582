"""Offset between two clocks from turn rates that both recorded, and why navigation may miss the scans."""

from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.time_scales import GPS_EPOCH, tai_minus_utc, utc

_MIN_STEP = 0.02  # [s], of the grid on which the rates are compared
_MIN_TIME = 20.0  # [s], common to both series
_MIN_CORRELATION = 0.5
_RIVAL = 0.8  # share of the best correlation from which on another offset makes the result ambiguous
_GAP = 1.0  # [s], longest gap that is interpolated, or 5 usual steps if these are longer
_WIDTHS = (1.0, 2.0)  # [s], of moving averages
_MAX_STEPS = 2_000_000  # of the grid, which take 200 MB
_MAX_SIGMA = 0.035  # [s], so that 0.1 s are three sigmas
_BLOCK = 5.0  # [s], duration within which errors may be correlated
_ON_EARTH = 1e8  # [s, Unix]: smaller stamps are not dates
_MAX_ZONE = 14  # [h], difference of a local clock from UTC
_DAY = 86_400.0


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """Offset between two clocks."""

    seconds: float  # to add to times of the first clock to get those of the second
    sigma: float  # its standard deviation [s]
    correlation: float  # of the turn rates at this offset, -1..1


def heading_rates(times: np.ndarray, headings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turn rates from compass headings (n,) [deg], NaN if missing, at times (n,) [s] in any order: (m,) times [s] and
    rates about the vertical [rad/s], positive to the left. Of several rows at one time the first counts."""
    known = np.isfinite(headings)
    times, first = np.unique(times[known], return_index=True)
    angles = -np.unwrap(np.radians(headings[known][first]))
    if len(times) < 2:
        return np.empty(0), np.empty(0)
    return (times[1:] + times[:-1]) / 2, np.diff(angles) / np.diff(times)


def estimate_offset(
    times_a: np.ndarray, rates_a: np.ndarray, times_b: np.ndarray, rates_b: np.ndarray, most: float = 60.0
) -> TimeOffset:
    """Estimate the offset between two clocks that makes turn rates agree. The rates are averaged over each of `_WIDTHS`
    and correlated at all offsets, the peak is interpolated, and the width with the smallest standard deviation counts.
    The standard deviation is that of the correlation's derivative, from its spread over blocks of time, divided by the
    second derivative.

    Args:
        times_a, times_b: (n,), (m,) by the first and the second clock [s], ascending.
        rates_a, rates_b: (n,), (m,) turn rates about the same axis [rad/s]; their scales and means do not matter.
        most: largest offset [s].
    """
    for times in (times_a, times_b):
        if len(times) < 3 or not (np.diff(times) > 0).all() or not np.isfinite(times).all():
            raise _refused("wanted three turn rates or more, at ascending times")
    usual = max(float(np.median(np.diff(times))) for times in (times_a, times_b))
    span = max(times_a[-1], times_b[-1]) - min(times_a[0], times_b[0])
    step = max(_MIN_STEP, usual / 2, min(span / _MAX_STEPS, _WIDTHS[0] / 4))  # coarser for dives of days
    if span > _MAX_STEPS * step:
        raise _refused(f"the times span {span / 86400:.0f} days, or have a jump; wanted those of one dive")
    reasons: list[InputError] = []
    estimates: list[TimeOffset] = []
    for width in _WIDTHS:
        try:
            estimates.append(_estimate((times_a, rates_a), (times_b, rates_b), step, max(width, usual), most))
        except InputError as error:
            reasons.append(error)
    if not estimates:
        raise reasons[0]
    best = min(estimates, key=lambda estimate: estimate.sigma)
    if best.sigma > _MAX_SIGMA:
        raise _refused(f"its standard deviation would be {best.sigma:.2f} s; wanted {_MAX_SIGMA:g} s at most")
    return best


_Rates = tuple[np.ndarray, np.ndarray]  # times [s] and rates


def _estimate(of_a: _Rates, of_b: _Rates, step: float, width: float, most: float) -> TimeOffset:
    """The offset from rates averaged over `width` [s] on a grid of `step` [s]."""
    start = min(of_a[0][0], of_b[0][0])
    a, known_a = _on_grid(of_a[0] - start, of_a[1], step, width)
    b, known_b = _on_grid(of_b[0] - start, of_b[1], step, width)
    lags, correlations = _correlations(a, known_a, b, known_b, round(most / step), _MIN_TIME / step)
    best = int(np.argmax(correlations))
    highest = float(correlations[best])
    if not np.isfinite(highest):
        raise _refused(f"they have less than {_MIN_TIME:g} s in common, or one of them does not turn")
    if highest < _MIN_CORRELATION:
        raise _refused(f"the turn rates agree at no offset (the highest correlation is {highest:.2f})")
    if best in (0, len(lags) - 1):
        raise _refused(f"the best offset, {lags[best] * step:.1f} s, is the limit of the search")
    rivals = np.where(np.abs(lags - lags[best]) > _lobe(correlations, best), correlations, -1.0)
    if rivals.max() > _RIVAL * highest:
        raise _refused(
            f"the turn rates agree at {lags[best] * step:.1f} s and nearly as well at "
            f"{lags[int(np.argmax(rivals))] * step:.1f} s, as where a vehicle turns regularly"
        )
    left, middle, right = correlations[best - 1 : best + 2]
    bend = left - 2 * middle + right
    shift = 0.5 * (left - right) / bend if np.isfinite(bend) and bend < 0 else 0.0
    moved = np.arange(len(b)) - lags[best]
    within = (moved >= 0) & (moved < len(a))
    moved = np.where(within, moved, 0)
    sigma = _sigma(a[moved], b, within & (known_a[moved] > 0) & (known_b > 0), step, width)
    return TimeOffset(float((lags[best] + shift) * step), sigma, highest)


def _sigma(a: np.ndarray, b: np.ndarray, known: np.ndarray, step: float, width: float) -> float:
    """Standard deviation of the offset [s], from rates `a`, `b` (n,) averaged over `width` [s] on one grid of `step`
    [s], with the offset applied; `known` (n,) bool in both."""
    a, b = (np.where(known, x - x[known].mean(), 0.0) for x in (a, b))
    slope_a, slope_b = (np.where(known, np.gradient(x, step), 0.0) for x in (a, b))
    # derivative of the correlation: the common signal cancels in every block, errors do not
    pulls = (a * slope_b - slope_a * b) / 2
    of_block = np.arange(len(a)) // max(round(max(_BLOCK, 3 * width) / step), 1)
    blocks = max(len(np.unique(of_block[known])), 2)
    spread = np.sqrt((np.bincount(of_block, pulls) ** 2).sum() * blocks / (blocks - 1))
    bend = float(slope_a @ slope_b)  # independent errors have a mean of 0 here
    if bend <= 0:
        return np.inf
    # also from all residuals as white noise, as there may be few blocks
    scale = np.sqrt(float(b @ b) / float(a @ a))
    residual = float(((b - scale * a) ** 2).sum())
    white = np.sqrt(residual * scale * width / (step * bend * scale**2 * max(known.sum(), 1))) if scale > 0 else np.inf
    return float(max(spread / bend, white)) + _MIN_STEP / 2


def _lobe(correlations: np.ndarray, best: int) -> int:
    """Half width of the peak [steps]: to the farther side's first lag below half of the peak."""
    reach = 1
    half = correlations[best] / 2
    for side in (correlations[best::-1], correlations[best:]):
        below = np.flatnonzero(side < half)
        reach = max(reach, int(below[0]) if len(below) else len(side))
    return reach


def _on_grid(times: np.ndarray, rates: np.ndarray, step: float, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Rates at 0, step, 2 step, ..., averaged over `width`, and 1.0 where they are known, else 0.0."""
    at = np.arange(0.0, times[-1] + step, step)
    total = np.concatenate([[0.0], np.cumsum((rates[1:] + rates[:-1]) / 2 * np.diff(times))])
    mean = (np.interp(at + width / 2, times, total) - np.interp(at - width / 2, times, total)) / width
    after = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
    most = max(_GAP, 5 * float(np.median(np.diff(times))))
    known = (at - width / 2 >= times[0]) & (at + width / 2 <= times[-1]) & (times[after] - times[after - 1] <= most)
    return np.where(known, mean, 0.0), known.astype(np.float64)


def _correlations(
    a: np.ndarray, known_a: np.ndarray, b: np.ndarray, known_b: np.ndarray, most: int, least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Lags from -most to most, and Pearson's correlation of `a` moved by each lag with `b`, where both are known; -inf
    if less than `least` samples are known or one of them is constant."""
    a = a - known_a * (a.sum() / max(known_a.sum(), 1.0))
    b = b - known_b * (b.sum() / max(known_b.sum(), 1.0))
    size = 1 << (len(a) + len(b) + most).bit_length()
    of_a = [np.conj(np.fft.rfft(x, size)) for x in (known_a, a, a * a)]
    of_b = [np.fft.rfft(x, size) for x in (known_b, b, b * b)]
    lags = np.arange(-most, most + 1)

    def summed(i: int, j: int) -> np.ndarray:
        return np.fft.irfft(of_a[i] * of_b[j], size)[lags % size]

    count = np.maximum(np.round(summed(0, 0)), 0.0)
    n = np.maximum(count, 1.0)
    mean_a, mean_b = summed(1, 0) / n, summed(0, 1) / n
    covariance = summed(1, 1) / n - mean_a * mean_b
    spread_a, spread_b = summed(2, 0) / n - mean_a**2, summed(0, 2) / n - mean_b**2
    changes = (spread_a > 1e-6 * max(a.var(), 1e-12)) & (spread_b > 1e-6 * max(b.var(), 1e-12))
    usable = (count >= max(least, 3.0)) & changes
    scale = np.sqrt(np.where(usable, spread_a * spread_b, 1.0))
    return lags, np.where(usable, covariance / scale, -np.inf)


def _refused(reason: str) -> InputError:
    return InputError(
        f"the clocks' offset cannot be estimated: {reason}; give it in seconds, as in --nav-offset 37, or leave it out"
    )


def why_apart(times: np.ndarray, stamps: np.ndarray) -> str:
    """Why no row is near a scan, in words: both spans, the gap and a likely cause. `times`: (n,) of the rows [s]."""
    first, last, start, end = (float(f(x)) for x in (times, stamps) for f in (np.min, np.max))
    gap = start - last if start > last else first - end
    apart = f"{gap:.3f} s apart" if gap > 0 else "and no two rows around a scan are at most 5 s apart"
    spans = f"the rows run from {_when(first)} to {_when(last)}, the scans from {_when(start)} to {_when(end)}, {apart}"
    cause = _cause(times, stamps) if gap > 0 else ""
    return f"{spans}{cause}; wanted stamps of one clock"


def _when(stamp: float) -> str:
    if not _ON_EARTH < stamp < 1e11:
        return f"{stamp:.3f} s"
    return f"{stamp:.3f} s ({utc(stamp)} UTC)"


def _cause(times: np.ndarray, stamps: np.ndarray) -> str:
    """The clock error, in words, whose correction brings most scans into the span of the navigation."""
    if stamps.max() < _ON_EARTH < times.max():
        return "; the scans are numbered, and have no times: use a column name instead of the times"
    if times.max() < _ON_EARTH < stamps.min():
        return "; the navigation's clock does not count from 1970: add its start by --nav-offset"
    leap = float(tai_minus_utc(stamps.min(keepdims=True))[0])
    gps = GPS_EPOCH - (leap - 19)
    causes = [
        (-(leap - 19), f"in GPS time, {leap - 19:.0f} s ahead of UTC: --time-scale gps"),
        (-leap, f"in TAI, {leap:.0f} s ahead of UTC: --time-scale tai"),
        (gps, "in seconds since 1980, as GPS counts them: --time-scale gps"),
        (1e9 + gps, f"in GPS seconds less 1e9, as LAS files have: --nav-offset={1e9 + gps:.0f}"),
    ]
    # whole hours first, and small offsets first
    for q in sorted(range(-4 * _MAX_ZONE, 4 * _MAX_ZONE + 1), key=lambda q: (q % 4 != 0, abs(q))):
        if q:
            side = "behind" if q > 0 else "ahead of"
            causes.append((900.0 * q, f"in local time, {abs(q) / 4:g} h {side} UTC: --nav-offset={900 * q}"))
    if day := round(float(np.median(stamps) - np.median(times)) / _DAY):
        causes.append((day * _DAY, f"of another day: --nav-offset={day * _DAY:.0f}"))
    covered = [((stamps >= times.min() + s) & (stamps <= times.max() + s)).mean() for s, _ in causes]
    best = int(np.argmax(covered))
    return f"; the navigation may be {causes[best][1]}" if covered[best] > 0 else ""
