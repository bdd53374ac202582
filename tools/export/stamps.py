"""What stamps say of the time: Unix seconds, or a mere counter."""

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

# 1990 and 2100 [s]: what lies outside is a counter, or the clock of a vehicle that does not know the date
_FIRST, _LAST = 631_152_000.0, 4_102_444_800.0


def are_times(stamps: np.ndarray) -> bool:
    """Whether stamps (N,) are all Unix seconds of 1990 to 2100; otherwise they only give an order."""
    return bool(np.all((stamps >= _FIRST) & (stamps < _LAST)))


def utc_texts(stamps: np.ndarray) -> Sequence[str]:
    """UTC times of stamps (N,) as ISO 8601 with microseconds and Z; all empty where they are no times."""
    if not are_times(stamps):
        return [""] * len(stamps)
    times = (datetime.fromtimestamp(stamp, UTC) for stamp in stamps.tolist())
    return [time.replace(tzinfo=None).isoformat(timespec="microseconds") + "Z" for time in times]
