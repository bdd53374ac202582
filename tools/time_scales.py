"""UTC and GPS time, and which stamps are times at all."""

from datetime import UTC, datetime

import numpy as np

GPS_EPOCH = 315_964_800  # 1980-01-06T00:00:00Z [s since 1970]
_LATEST = 4_102_444_800  # 2100
# From these dates (UTC) GPS time is 1, 2, ... 18 s ahead of UTC: IERS Bulletin C.
_LEAPS = (
    *("1981-07-01", "1982-07-01", "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01", "1991-01-01", "1992-07-01"),
    *("1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01", "1999-01-01", "2006-01-01", "2009-01-01", "2012-07-01"),
    *("2015-07-01", "2017-01-01"),
)
_LEAP_STAMPS = np.array([datetime.fromisoformat(day).replace(tzinfo=UTC).timestamp() for day in _LEAPS])


def are_times(stamps: np.ndarray) -> bool:
    """Whether stamps (N,) [s] are times since 1970 in UTC, and not counted from 0 or by another clock."""
    return bool(stamps.size and stamps.min() >= GPS_EPOCH and stamps.max() < _LATEST)


def gps_of_utc(stamps: np.ndarray) -> np.ndarray:
    """(N,) float64 seconds since GPS's epoch, leap seconds counted, of times (N,) since 1970 in UTC [s]."""
    return stamps - GPS_EPOCH + np.searchsorted(_LEAP_STAMPS, stamps, side="right")


def utc_text(stamp: float) -> str:
    """A time since 1970 in UTC [s], as 2026-07-01T09:30:00.250000Z."""
    return datetime.fromtimestamp(stamp, UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")
