"""The shots of a recording in their order, each with its strength image, whichever of the two came first.

Their numbers wrap, start again, and tell how many are missing.
"""

import heapq
import zlib
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from wlsonar import range_image_protocol as rip

from sonarmap.tools.files.readers.sonar.messages import Frame, stamp_of, strength_of

REACH = 16  # shots that a packet may come too late
WAITING = REACH + 1  # shots that wait: with fewer, a shot that comes late leaves before its strength image
_EARLY = 2 * REACH  # strength images that wait for their range image

_RANGE = 1 << 32  # sequence_id is a uint32, and begins at 0 again
_MOST_MISSING = 1 << 16  # in a row; more is another count of a sonar that was restarted
_REMEMBERED = 1 << 16


class ShotNumbers:
    """Puts wrapping numbers in one order as they come, and counts: shots that came `late`, after a later one, how often
    the numbers wrapped, and how often they started again (`restarts`). A fall by more than half of 2^32 is a wrap, one
    by a few a packet that came late, any other that the count started again, as after a restart of the sonar."""

    def __init__(self) -> None:
        self.late = self.wraps = self.restarts = 0
        self._missing_before = self._count = 0
        self._number = self._place = self._lowest = 0  # of the latest shot, and of the first since the last restart
        self._stamp: float | None = None

    @property
    def missing(self) -> int:
        """How many numbers between the first and the last, since each restart, did not come."""
        return self._missing_before + (self._place - self._lowest + 1 - self._count if self._count else 0)

    def place(self, number: int, stamp: float | None) -> int:
        """Where a shot that did not come before belongs, by its number, 0 to 2^32 - 1, and its time [s]: ascends in the
        order in which shots were taken, by 1 if none is missing."""
        step = (number - self._number + _RANGE // 2) % _RANGE - _RANGE // 2
        is_later = stamp is not None and self._stamp is not None and stamp > self._stamp
        if self._count and -REACH <= step < 0 and not is_later:
            self.late += 1
            self._count += 1
            self._lowest = min(self._lowest, self._place + step)
            return self._place + step
        if self._count and 0 < step <= _MOST_MISSING:
            self.wraps += number < self._number
            self._count += 1
            self._place += step
        else:
            self._start_again()
        self._number, self._stamp = number, stamp
        return self._place

    def _start_again(self) -> None:
        self.restarts += self._count > 0
        self._missing_before = self.missing
        self._place += 2 * REACH  # late ones still come before it, and after what was there before
        self._lowest, self._count = self._place, 1


class Remembered:
    """The latest keys of many, to recognize what comes twice."""

    def __init__(self, most: int = _REMEMBERED) -> None:
        self._keys: dict[Hashable, None] = {}
        self._most = most

    def is_new(self, key: Hashable) -> bool:
        """Whether the key did not come before; it is remembered, and the oldest forgotten where there are too many."""
        is_new = key not in self._keys
        self._keys.setdefault(key)
        if len(self._keys) > self._most:
            del self._keys[next(iter(self._keys))]
        return is_new


@dataclass(frozen=True, slots=True)
class Shot:
    """A range image with what belongs to it."""

    place: int  # ascends from shot to shot, by 1 if none is missing
    frame: Frame  # the range image
    strength: np.ndarray | None = None  # (N,) float64 linear echo strength of the frame's points, or None


class ShotQueue:
    """Shots wait here until seventeen have come after them: for strength images, and for shots that come late.
    `doubled` images came twice, and were left out; the range image of a strength image that is `alone` never came."""

    def __init__(self) -> None:
        self.numbers = ShotNumbers()
        self.doubled = self.alone = 0
        self._order: list[tuple[int, int]] = []  # a heap of (place, arrival)
        self._arrivals = count()
        self._shots: dict[int, Shot] = {}  # by arrival
        self._latest: dict[int, int] = {}  # number -> arrival
        self._early: dict[int, rip.BitmapImageGreyscale8] = {}  # by number
        self._frames, self._strengths = Remembered(), Remembered()

    def add_frame(self, frame: Frame) -> None:
        """A range image has come. Raises InputError: its strength image came before, and does not fit; the shot is kept
        without it."""
        if not self._frames.is_new((frame.number, frame.stamp or zlib.crc32(frame.points.tobytes()))):
            self.doubled += 1
            return
        arrival = next(self._arrivals)
        place = self.numbers.place(frame.number, frame.stamp)
        self._shots[arrival] = Shot(place, frame)
        self._latest[frame.number] = arrival
        heapq.heappush(self._order, (place, arrival))
        image = self._early.get(frame.number)
        if image is not None and _together(frame, image):
            del self._early[frame.number]
            self._join(arrival, image)

    def add_strength(self, image: rip.BitmapImageGreyscale8) -> None:
        """A strength image has come. Raises InputError: it does not fit the range image of its shot."""
        number = image.header.sequence_id
        if not self._strengths.is_new((number, stamp_of(image) or zlib.crc32(image.image_pixel_data))):
            self.doubled += 1
            return
        arrival = self._latest.get(number)
        if arrival is not None and _together(self._shots[arrival].frame, image):
            self._join(arrival, image)
            return
        self.alone += self._early.pop(number, None) is not None
        self._early[number] = image
        if len(self._early) > _EARLY:
            del self._early[next(iter(self._early))]
            self.alone += 1

    def shots(self, waiting: int) -> Iterator[Shot]:
        """Shots in their order until so many wait."""
        while len(self._order) > waiting:
            _, arrival = heapq.heappop(self._order)
            shot = self._shots.pop(arrival)
            if self._latest.get(shot.frame.number) == arrival:
                del self._latest[shot.frame.number]
            yield shot

    def rest(self) -> Iterator[Shot]:
        """Those that wait, when the recording has ended."""
        yield from self.shots(0)
        self.alone += len(self._early)
        self._early.clear()

    def _join(self, arrival: int, image: rip.BitmapImageGreyscale8) -> None:
        shot = self._shots[arrival]
        self._shots[arrival] = replace(shot, strength=strength_of(shot.frame, image))


def _together(frame: Frame, image: rip.BitmapImageGreyscale8) -> bool:
    """Whether two images of one number are of one shot: numbers may start again."""
    stamp = stamp_of(image)
    return stamp is None or frame.stamp is None or stamp == frame.stamp
