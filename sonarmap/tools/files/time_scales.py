"""UTC, GPS time and TAI, which run on where UTC inserts leap seconds; which stamps are times at all, and what is wrong
with a recording's clock."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal

import numpy as np

TimeScale = Literal["utc", "gps", "tai"]
TIME_SCALES: tuple[TimeScale, ...] = ("utc", "gps", "tai")

WEEK = 604_800.0  # [s]
GPS_EPOCH = 315_964_800.0  # 1980-01-06 00:00 UTC [s, Unix]
TAI_GPS = 19.0  # TAI - GPS time [s], always
# TAI - UTC [s] from these Unix times on: IERS Bulletin C, as in IANA's leap-seconds.list; none is announced for 2026
_LEAPS = (
    (63072000, 10), (78796800, 11), (94694400, 12), (126230400, 13), (157766400, 14), (189302400, 15), (220924800, 16),
    (252460800, 17), (283996800, 18), (315532800, 19), (362793600, 20), (394329600, 21), (425865600, 22),
    (489024000, 23), (567993600, 24), (631152000, 25), (662688000, 26), (709948800, 27), (741484800, 28),
    (773020800, 29), (820454400, 30), (867715200, 31), (915148800, 32), (1136073600, 33), (1230768000, 34),
    (1341100800, 35), (1435708800, 36), (1483228800, 37),
)  # fmt: skip
# 1990 and 2100 [s]: what lies outside is a counter, or the clock of a vehicle that does not know the date
TIMES = 631_152_000.0, 4_102_444_800.0
_STARTS = np.array([start for start, _ in _LEAPS], np.float64)
_OFFSETS = np.array([offset for _, offset in _LEAPS], np.float64)

_GAP = 1.5  # usual steps between scans; a longer one is a gap
_SET = datetime(1980, 1, 1, tzinfo=UTC).timestamp()  # of a clock that is set [s]
_LEAST_PERIOD = 1e-9  # [s]; nothing takes scans faster
_AHEAD = 60.0  # seconds that a clock may be ahead of the file's, which was written when the recording ended


def tai_minus_utc(utc: np.ndarray) -> np.ndarray:
    """(n,) [s] at Unix times (n,) [s]; before 1972 what it was then, 10 s."""
    return _OFFSETS[np.maximum(np.searchsorted(_STARTS, utc, side="right") - 1, 0)]


def utc_of_tai(tai: np.ndarray) -> np.ndarray:
    """(n,) Unix times [s] of seconds since 1970-01-01 00:00 TAI (n,), as PTP counts them."""
    return tai - _OFFSETS[np.maximum(np.searchsorted(_STARTS + _OFFSETS, tai, side="right") - 1, 0)]


def utc_of_gps(seconds: np.ndarray) -> np.ndarray:
    """(n,) Unix times [s] of seconds since the GPS epoch, 1980-01-06 00:00 UTC."""
    return utc_of_tai(seconds + GPS_EPOCH + TAI_GPS)


def gps_of_utc(utc: np.ndarray) -> np.ndarray:
    """(n,) seconds since the GPS epoch, leap seconds counted, of Unix times (n,) [s]."""
    return utc + tai_minus_utc(utc) - TAI_GPS - GPS_EPOCH


def are_times(stamps: np.ndarray) -> bool:
    """Whether stamps (n,) are all Unix seconds of 1990 to 2100; otherwise they only give an order."""
    return bool(stamps.size and np.all((stamps >= TIMES[0]) & (stamps < TIMES[1])))


def utc_text(stamp: float) -> str:
    """A Unix time [s] as 2026-07-01T09:30:00.250000Z."""
    return datetime.fromtimestamp(stamp, UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


def utc_texts(stamps: np.ndarray) -> Sequence[str]:
    """As `utc_text`, of stamps (n,); all empty where they are no times."""
    return [utc_text(stamp) for stamp in stamps.tolist()] if are_times(stamps) else [""] * len(stamps)


@dataclass(frozen=True, slots=True)
class Clock:
    """The stamps of scans in their order."""

    start: float  # start, end: the earliest and the latest stamp [s, UTC]
    end: float
    period: float  # the usual step between scans [s], their median; 0 for a single scan, or a clock that stands still
    gaps: int  # how many steps are longer than 1.5 usual ones
    longest: float  # of the steps [s]
    backward: int  # how many steps are not above 0
    still: int  # how many of these are 0
    steps: int  # how many there are

    @property
    def is_set(self) -> bool:
        """Whether it can be UTC: clocks that were never set start in 1970."""
        return self.end >= _SET

    @property
    def stands_still(self) -> bool:
        return self.still > self.steps / 2

    @property
    def rate(self) -> float | None:
        """Scans per second [1/s], None where it is not known."""
        return 1 / self.period if self.period > _LEAST_PERIOD else None


def clock_of(stamps: np.ndarray) -> Clock:
    """The clock of (n,) stamps [s], n >= 1, in the order of the scans."""
    steps = np.diff(stamps)
    ahead = steps[steps > 0]
    still = int((steps == 0).sum())
    period = float(np.median(ahead)) if len(ahead) > still else 0.0
    gaps = int((steps > _GAP * period).sum()) if period else 0
    longest, backward = float(steps.max(initial=0.0)), int((steps <= 0).sum())
    return Clock(float(stamps.min()), float(stamps.max()), period, gaps, longest, backward, still, len(steps))


def clock_faults(clock: Clock, changed: float | None = None) -> list[str]:
    """What is wrong with a clock that should show UTC, in words. `changed`: when the recording's file was last changed
    [s, UTC], if that is known."""
    if clock.stands_still:
        return [f"the clock stands still: {clock.still:,} of {clock.steps:,} stamps are those of the shot before"]
    faults = []
    if clock.backward:
        faults.append(f"{clock.backward:,} of {clock.steps:,} stamps are not later than that of the shot before")
    if not clock.is_set:
        faults.append(f"the clock was not set: it ends at {utc(clock.end)} UTC")
    elif changed is not None and clock.end > changed + _AHEAD:
        faults.append(
            f"the clock is ahead: it ends at {utc(clock.end)} UTC, and the file was last changed at {utc(changed)} UTC"
        )
    return faults


def utc(stamp: float) -> str:
    """The time in words, to the second; the number where no calendar has it."""
    try:
        return datetime.fromtimestamp(stamp, UTC).strftime("%Y-%m-%d %H:%M:%S")
    except (ValueError, OverflowError, OSError):
        return f"{stamp:g} s"
