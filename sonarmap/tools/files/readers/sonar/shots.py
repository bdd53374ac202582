"""The shots of a recording in their order, each with its strength image, whichever of the two came first."""

import heapq
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from wlsonar import range_image_protocol as rip

from sonarmap.tools.files.readers.sonar.frames import Frame, stamp_of, strength_of
from sonarmap.tools.files.readers.sonar.shot_numbers import REACH, Remembered, ShotNumbers

_EARLY = 2 * REACH  # strength images that wait for their range image


@dataclass(frozen=True, slots=True)
class Shot:
    """A range image with what belongs to it.

    Attributes:
        place: ascends from shot to shot, by 1 if none is missing.
        frame: the range image.
        strength: (N,) float64 linear echo strength of the frame's points, or None.
    """

    place: int
    frame: Frame
    strength: np.ndarray | None = None


class ShotQueue:
    """Shots wait here until seventeen have come after them: for strength images, and for shots that come late.

    Attributes:
        numbers: of the shots.
        doubled: images that came twice, and were left out.
        alone: strength images whose range image never came.
    """

    def __init__(self) -> None:
        self.numbers = ShotNumbers()
        self.doubled = self.alone = 0
        self._order: list[tuple[int, int, int]] = []  # a heap of (place, arrival, number)
        self._arrivals = count()
        self._shots: dict[int, Shot] = {}  # by arrival
        self._latest: dict[int, int] = {}  # number -> arrival
        self._early: dict[int, rip.BitmapImageGreyscale8] = {}  # by number
        self._frames, self._strengths = Remembered(), Remembered()

    def add_frame(self, frame: Frame) -> None:
        """A range image has come. Raises InputError: its strength image came before, and does not fit; the shot is kept
        without it."""
        key = (frame.number, frame.stamp or zlib.crc32(frame.points.tobytes()))
        if key in self._frames:
            self.doubled += 1
            return
        self._frames.add(key)
        arrival = next(self._arrivals)
        place = self.numbers.place(frame.number, frame.stamp)
        self._shots[arrival] = Shot(place, frame)
        self._latest[frame.number] = arrival
        heapq.heappush(self._order, (place, arrival, frame.number))
        image = self._early.get(frame.number)
        if image is not None and _together(frame, image):
            del self._early[frame.number]
            self._join(arrival, image)

    def add_strength(self, image: rip.BitmapImageGreyscale8) -> None:
        """A strength image has come. Raises InputError: it does not fit the range image of its shot."""
        number = image.header.sequence_id
        key = (number, stamp_of(image) or zlib.crc32(image.image_pixel_data))
        if key in self._strengths:
            self.doubled += 1
            return
        self._strengths.add(key)
        arrival = self._latest.get(number)
        if arrival is not None and _together(self._shots[arrival].frame, image):
            self._join(arrival, image)
            return
        self.alone += self._early.pop(number, None) is not None
        self._early[number] = image
        if len(self._early) > _EARLY:
            del self._early[next(iter(self._early))]
            self.alone += 1

    def ready(self) -> Iterator[Shot]:
        """Shots that nothing can come before any more, in order."""
        while len(self._order) > REACH + 1:  # or a shot that comes last of these leaves before its strength image
            yield self._pop()

    def rest(self) -> Iterator[Shot]:
        """All that wait, when the recording has ended."""
        while self._order:
            yield self._pop()
        self.alone += len(self._early)
        self._early.clear()

    def _join(self, arrival: int, image: rip.BitmapImageGreyscale8) -> None:
        shot = self._shots[arrival]
        self._shots[arrival] = replace(shot, strength=strength_of(shot.frame, image))

    def _pop(self) -> Shot:
        _, arrival, number = heapq.heappop(self._order)
        if self._latest.get(number) == arrival:
            del self._latest[number]
        return self._shots.pop(arrival)


def _together(frame: Frame, image: rip.BitmapImageGreyscale8) -> bool:
    """Whether two images of one number are of one shot: numbers may start again."""
    stamp = stamp_of(image)
    return stamp is None or frame.stamp is None or stamp == frame.stamp
