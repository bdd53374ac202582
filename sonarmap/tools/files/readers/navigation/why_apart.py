"""Why the times of navigation may miss those of the scans, in words."""

import numpy as np

from sonarmap.tools.files.time_scales import GPS_EPOCH, tai_minus_utc, utc

_ON_EARTH = 1e8  # [s, Unix]: smaller stamps are not dates
_MAX_ZONE = 14  # [h], difference of a local clock from UTC
_DAY = 86_400.0


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
