"""GPS time, which counts the leap seconds that UTC inserts."""

from datetime import UTC, datetime

import numpy as np

_EPOCH = 315_964_800  # 1980-01-06T00:00:00Z [s since 1970]
# From these dates (UTC) GPS time is 1, 2, ... 18 s ahead of UTC: IERS Bulletin C.
_LEAPS = (
    *("1981-07-01", "1982-07-01", "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01", "1991-01-01", "1992-07-01"),
    *("1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01", "1999-01-01", "2006-01-01", "2009-01-01", "2012-07-01"),
    *("2015-07-01", "2017-01-01"),
)
_STARTS = np.array([datetime.fromisoformat(day).replace(tzinfo=UTC).timestamp() for day in _LEAPS])


def utc_of_gps(seconds: float) -> float:
    """Seconds since 1970 in UTC, of seconds since GPS's epoch in 1980."""
    uncorrected = seconds + _EPOCH
    starts = _STARTS + np.arange(1, len(_STARTS) + 1)  # as GPS time counts them
    return uncorrected - int(np.searchsorted(starts, uncorrected, side="right"))
