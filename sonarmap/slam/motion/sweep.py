"""Sweeps: how long a sensor that takes its points in turn needs for a scan, and the unit of the points' times."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sonarmap.spectral.point_store import PointStore
from sonarmap.spectral.scan import Scan

# Possible sweeps [s]: in the water the shortest ping takes longer than a millisecond, and the next scan follows
_SHORTEST_SWEEP, _LONGEST_SWEEP, _OVERLAP = 1e-3, 10.0, 1.2  # the longest where scans have no stamps; else [intervals]
# Factor to seconds -> unit. Large counts in messages are read as nanoseconds, and may be microseconds.
_TIME_UNITS = {1.0: "seconds", 1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds", 1e3: "microseconds"}


def span_of(scan: Scan | None) -> float:
    """From the time of its first point to that of the last, as read; 0 without times."""
    return 0.0 if scan is None or scan.times is None else float(np.ptp(scan.times))


@dataclass(frozen=True, slots=True)
class Sweep:
    """How long the sensor takes for a scan, by the times of its points."""

    seconds: float = 0.0  # in the median; 0 without times
    factor: float | None = 1.0  # by which times as read become seconds; None if they are impossible in any unit
    limit: float = _LONGEST_SWEEP  # longest that is possible [s]
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, spans: Sequence[float], stamps: Sequence[float | None]) -> "Sweep":
        """The unit of the times is one in which a sweep takes no longer than it is from scan to scan. Spans (0 without
        times) and stamps (None if a file has none) are those of the scans."""
        known = np.array([stamp for stamp in stamps if stamp is not None])
        steps = np.diff(known)[np.diff(known) > 0]
        limit = _OVERLAP * float(np.median(steps)) if len(steps) else _LONGEST_SWEEP
        if not any(spans):
            return cls()
        span = float(np.median([span for span in spans if span]))
        factor = next((factor for factor in _TIME_UNITS if _SHORTEST_SWEEP <= factor * span <= limit), None)
        if factor is None:
            possible = f"{_SHORTEST_SWEEP:g} to {limit:.3g} s are possible"
            note = f"a sweep takes {span:.3g} s by the times of its points, and {possible}: they are not used"
            return cls(span, None, limit, (note,))
        note = f"the times of points are taken as {_TIME_UNITS[factor]}, by which a sweep takes {factor * span:.3g} s"
        return cls(factor * span, factor, limit, (note,) if factor != 1 else ())

    def in_seconds(self, scan: Scan | None, store: PointStore) -> Scan | None:
        """The scan with times in seconds; if these are by another clock than its stamp, from its first point on."""
        if scan is None or scan.times is None:
            return scan
        if self.factor is None:
            return replace(scan, times=None)
        times = self.factor * scan.times.astype(np.float64)
        if (is_other_clock := np.abs(times).max() > 2 * self.limit) or self.factor != 1:
            times -= times.min() * is_other_clock
            return replace(scan, times=store.keep(times.astype(np.float32)))
        return scan
