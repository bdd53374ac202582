"""What is wrong with scans: their clock, their unit, and copies, which a map would believe."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from sonarmap.spectral.scan import Scan

_GAP = 1.5  # usual steps between scans; a longer one is a gap
_SET = datetime(1980, 1, 1, tzinfo=UTC).timestamp()
_LEAST_PERIOD = 1e-9  # seconds; nothing takes scans faster
_AHEAD = 60.0  # seconds that a clock may be ahead of the file's, which was written when the recording ended
_SAMPLE = 1000  # points of a scan that are looked at
_LEAST_SCANS = 3  # of two nobody knows which is wrong
_LEAST_POINTS = 100  # of fewer the spread says nothing
# Views of one place differ in range by tens; a scan in centimeters beside others in meters by a hundred. One that is so
# much smaller than the others fills three voxels of a grid of 128, and nothing is lost with it.
_STRANGE = 40.0
_UNITS = {"centimeters": (40, 300), "millimeters": (300, 3000)}  # times
_LISTED = 5  # scans in a sentence
_FIRST = 64  # points by which scans are compared first


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


def strange_sizes(scans: Sequence[Scan]) -> dict[int, str]:
    """What is wrong with scans that are 40 times larger or smaller, or more, than the others, by their index. `scans`:
    of one survey."""
    many = ((k, scan) for k, scan in enumerate(scans) if len(scan.points) >= _LEAST_POINTS)
    sizes = {k: size for k, scan in many if (size := _size(scan)) > 0}
    if len(sizes) < _LEAST_SCANS:
        return {}
    usual = float(np.median(list(sizes.values())))
    strange = {k: size for k, size in sizes.items() if not 1 / _STRANGE < size / usual < _STRANGE}
    return {k: _in_words(size, usual, size / usual) for k, size in strange.items()}


def _size(scan: Scan) -> float:
    """The median distance of the points from their middle [m], which a scan of a map has, too."""
    points = scan.points[:: -(-len(scan.points) // _SAMPLE)].astype(np.float64)
    return float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))


def _in_words(size: float, usual: float, times: float) -> str:
    factor = f"{times:.3g} times larger" if times > 1 else f"{1 / times:.3g} times smaller"
    ratio = max(times, 1 / times)
    unit = next((unit for unit, (least, most) in _UNITS.items() if least <= ratio < most), "another unit")
    hint = f"as if {'it was' if times > 1 else 'the others were'} in {unit}"
    return (
        f"its points are spread over {size:.3g} m, those of the other scans over {usual:.3g} m: {factor}, {hint}; "
        "write all scans in one unit (--units says which)"
    )


def same_points(scans: Sequence[Scan]) -> list[tuple[int, int]]:
    """Each scan whose points are exactly those of an earlier one, and the first that has them: (earlier, later)."""
    firsts: dict[tuple[int, bytes], list[int]] = {}
    pairs: list[tuple[int, int]] = []
    for k, scan in enumerate(scans):
        alike = firsts.setdefault((len(scan.points), scan.points[:_FIRST].tobytes()), [])
        earlier = next((j for j in alike if np.array_equal(scans[j].points, scan.points)), k)
        if earlier == k:
            alike.append(k)
        else:
            pairs.append((earlier, k))
    return pairs


def repeated_in_words(given_twice: Sequence[Path], scans: Sequence[Scan]) -> list[str]:
    """What to tell the user of files that several of the given paths name, and are read once, and of scans that are
    another's copy; none if all is well."""
    words: list[str] = []
    if given_twice:
        words.append(f"given more than once, and used once: {_listed([str(path) for path in given_twice])}")
    if copies := same_points(scans):
        named = _listed([f"{scans[later].name} of {scans[earlier].name}" for earlier, later in copies])
        words.append(f"the same points twice: {named}; leave the copies out, or the map believes them twice")
    return words


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_LISTED]) + (f" and {len(names) - _LISTED:,} more" if len(names) > _LISTED else "")
