"""Conversions between UTC, GPS time and TAI, which have no leap seconds; and faults of a recording's clock."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal

import numpy as np

TimeScale = Literal["utc", "gps", "tai"]
TIME_SCALES: tuple[TimeScale, ...] = ("utc", "gps", "tai")

WEEK = 604_800.0  # [s]
YEAR = 365.25 * 86_400.0  # [s]
GPS_EPOCH = 315_964_800.0  # 1980-01-06 00:00 UTC [s, Unix]
TAI_GPS = 19.0  # TAI - GPS time [s], always
# (Unix time, TAI - UTC from then on) [s]: IERS Bulletin C, as in IANA's leap-seconds.list; none is announced for 2026
_LEAPS = (
    (63072000, 10), (78796800, 11), (94694400, 12), (126230400, 13), (157766400, 14), (189302400, 15), (220924800, 16),
    (252460800, 17), (283996800, 18), (315532800, 19), (362793600, 20), (394329600, 21), (425865600, 22),
    (489024000, 23), (567993600, 24), (631152000, 25), (662688000, 26), (709948800, 27), (741484800, 28),
    (773020800, 29), (820454400, 30), (867715200, 31), (915148800, 32), (1136073600, 33), (1230768000, 34),
    (1341100800, 35), (1435708800, 36), (1483228800, 37),
)  # fmt: skip
# 1990 and 2100 [s]: stamps outside are a counter, or from a clock that was never set
TIMES = 631_152_000.0, 4_102_444_800.0
_STARTS = np.array([start for start, _ in _LEAPS], np.float64)
_OFFSETS = np.array([offset for _, offset in _LEAPS], np.float64)

_GAP = 1.5  # a step between scans is a gap if it is longer than the median step times this
_SET = datetime(1980, 1, 1, tzinfo=UTC).timestamp()  # earliest stamp of a clock that was set [s]
_LEAST_PERIOD = 1e-9  # shortest time between scans [s]
_SET_CLOCK = "set the sonar's clock by NTP, before the dive and not in it"
_AHEAD = 60.0  # the last stamp may be later than the file's modification time by this [s]


def tai_minus_utc(utc: np.ndarray) -> np.ndarray:
    """TAI - UTC (n,) [s] at Unix times (n,) [s]; 10 s before 1972."""
    return _OFFSETS[np.maximum(np.searchsorted(_STARTS, utc, side="right") - 1, 0)]


def utc_of_tai(tai: np.ndarray) -> np.ndarray:
    """Unix times (n,) [s] of seconds since 1970-01-01 00:00 TAI (n,), as PTP counts them."""
    return tai - _OFFSETS[np.maximum(np.searchsorted(_STARTS + _OFFSETS, tai, side="right") - 1, 0)]


def utc_of_gps(seconds: np.ndarray) -> np.ndarray:
    """Unix times (n,) [s] of seconds since the GPS epoch, 1980-01-06 00:00 UTC."""
    return utc_of_tai(seconds + GPS_EPOCH + TAI_GPS)


def gps_of_utc(utc: np.ndarray) -> np.ndarray:
    """Seconds (n,) since the GPS epoch, leap seconds included, of Unix times (n,) [s]."""
    return utc + tai_minus_utc(utc) - TAI_GPS - GPS_EPOCH


def are_times(stamps: np.ndarray) -> bool:
    """Whether all stamps (n,) are Unix times from 1990 to 2100 [s]; otherwise they only give an order."""
    return bool(stamps.size and np.all((stamps >= TIMES[0]) & (stamps < TIMES[1])))


def by_clock(times: np.ndarray) -> list[np.ndarray]:
    """The indices of times (n,) [s], divided where they are more than a year apart, as those of two clocks are."""
    order = np.argsort(times, kind="stable")
    return np.split(order, 1 + np.flatnonzero(np.diff(times[order]) > YEAR))


def years_apart(times: np.ndarray, others: np.ndarray) -> str:
    """How far times [s] are from others, as "20.0 years after"."""
    years = float(np.median(times) - np.median(others)) / YEAR
    return f"{abs(years):.1f} years {'after' if years > 0 else 'before'}"


def utc_text(stamp: float) -> str:
    """A Unix time [s] in ISO format, as 2026-07-01T09:30:00.250000Z."""
    return datetime.fromtimestamp(stamp, UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


def utc_texts(stamps: np.ndarray) -> Sequence[str]:
    """`utc_text` of each of the stamps (n,); empty texts if they are not times."""
    return [utc_text(stamp) for stamp in stamps.tolist()] if are_times(stamps) else [""] * len(stamps)


@dataclass(frozen=True, slots=True)
class Clock:
    """Statistics of the stamps of scans, in the scans' order."""

    start: float  # earliest stamp [s, UTC]
    end: float  # latest stamp [s, UTC]
    period: float  # median step between scans [s]; 0 for a single scan, or a clock that stands still
    gaps: int  # number of steps longer than 1.5 periods
    longest: float  # longest step [s]
    backward: int  # number of steps that are zero or negative
    still: int  # number of steps that are zero
    steps: int  # number of steps

    @property
    def is_set(self) -> bool:
        """Whether the stamps can be UTC: clocks that were never set start in 1970."""
        return self.end >= _SET

    @property
    def stands_still(self) -> bool:
        return self.still > self.steps / 2

    @property
    def rate(self) -> float | None:
        """Scan rate [1/s]; None if it is unknown."""
        return 1 / self.period if self.period > _LEAST_PERIOD else None


def clock_of(stamps: np.ndarray) -> Clock:
    """Clock statistics of stamps (n,) [s], n >= 1, in the order of the scans."""
    steps = np.diff(stamps)
    ahead = steps[steps > 0]
    still = int((steps == 0).sum())
    period = float(np.median(ahead)) if len(ahead) > still else 0.0
    gaps = int((steps > _GAP * period).sum()) if period else 0
    longest, backward = float(steps.max(initial=0.0)), int((steps <= 0).sum())
    return Clock(float(stamps.min()), float(stamps.max()), period, gaps, longest, backward, still, len(steps))


def clock_faults(clock: Clock, changed: float | None = None) -> list[str]:
    """Messages about faults of a clock that should show UTC. `changed`: modification time of the recording's file
    [s, UTC], if it is known."""
    if clock.stands_still:
        still = f"{clock.still:,} of {clock.steps:,} stamps are those of the shot before"
        return [f"the clock stands still: {still}; {_SET_CLOCK}"]
    faults = []
    if clock.backward:
        backward = f"{clock.backward:,} of {clock.steps:,} stamps are not later than that of the shot before"
        faults.append(f"{backward}; {_SET_CLOCK}, and give the scans in the order of their times")
    if not clock.is_set:
        faults.append(f"the clock was not set: it ends at {utc(clock.end)} UTC")
    elif changed is not None and clock.end > changed + _AHEAD:
        faults.append(
            f"the clock is ahead: it ends at {utc(clock.end)} UTC, and the file was last changed at {utc(changed)} UTC"
        )
    return faults


def utc(stamp: float) -> str:
    """A Unix time as date and time to the second; as a number if it is beyond the calendar."""
    try:
        return datetime.fromtimestamp(stamp, UTC).strftime("%Y-%m-%d %H:%M:%S")
    except (ValueError, OverflowError, OSError):
        return f"{stamp:g} s"
