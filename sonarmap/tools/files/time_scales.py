"""UTC, GPS time and TAI, which run on where UTC inserts leap seconds; and which stamps are times at all."""

from collections.abc import Sequence
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
