"""What the stamps of scans say about the clock that they come from."""

from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

_GAP = 1.5  # usual steps between scans; a longer one is a gap
_SET = datetime(1980, 1, 1, tzinfo=UTC).timestamp()
_LEAST_PERIOD = 1e-9  # seconds; nothing takes scans faster
_AHEAD = 60.0  # seconds that a clock may be ahead of the file's, which was written when the recording ended


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
        """Whether most stamps are the same."""
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
