"""Why navigation and scans do not meet in time, in words."""

import numpy as np

from sonarmap.tools.files.readers.clock import utc
from sonarmap.tools.files.time_scales import GPS_EPOCH, tai_minus_utc

_ON_EARTH = 1e8  # smaller numbers are no date [s, Unix]
_MOST_ZONE = 14  # hours that a local clock is ahead of UTC
_DAY = 86_400.0


def why_apart(times: np.ndarray, stamps: np.ndarray) -> str:
    """Both spans, how far apart they are, and what may have happened.

    Args:
        times: (n,) of the navigation [s].
    """
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
    """The change of the navigation's times that brings most scans into its span, in words."""
    if stamps.max() < _ON_EARTH < times.max():
        return "; the scans are numbered, and have no times: use a column name instead of the times"
    if times.max() < _ON_EARTH < stamps.min():
        return "; the navigation's clock counts from a start of its own: add it by --nav-offset"
    leap = float(tai_minus_utc(stamps.min(keepdims=True))[0])
    gps = GPS_EPOCH - (leap - 19)
    causes = [(-(leap - 19), f"in GPS time, {leap - 19:.0f} s ahead of UTC: --time-scale gps")]
    causes += [(-leap, f"in TAI, {leap:.0f} s ahead of UTC: --time-scale tai")]
    causes += [(gps, "in seconds since 1980, as GPS counts them: --time-scale gps")]
    causes += [(1e9 + gps, f"in GPS seconds less 1e9, as LAS files have: --nav-offset={1e9 + gps:.0f}")]
    # whole hours before the others, and near ones before far ones
    quarters = [q for q in range(-4 * _MOST_ZONE, 4 * _MOST_ZONE + 1) if q]
    for q in sorted(quarters, key=lambda q: (q % 4 != 0, abs(q))):
        side = "behind" if q > 0 else "ahead of"
        causes.append((900.0 * q, f"in local time, {abs(q) / 4:g} h {side} UTC: --nav-offset={900 * q}"))
    day = round(float(np.median(stamps) - np.median(times)) / _DAY)
    causes += [(day * _DAY, f"of another day: --nav-offset={day * _DAY:.0f}")] if day else []
    covered = [((stamps >= times.min() + s) & (stamps <= times.max() + s)).mean() for s, _ in causes]
    best = int(np.argmax(covered))
    return f"; the navigation may be {causes[best][1]}" if covered[best] > 0 else ""
