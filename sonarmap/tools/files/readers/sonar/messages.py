"""A packet's message, decoded by wlsonar, and the shots of a recording in their order.

The pixels of a range image are decoded here, at once, to points. The device looks along x with y to the right and z
DOWN (wlsonar, Range Image Protocol RIP2); the points are turned here, once, to x forward, y left, z up. A shot has its
strength image, whichever of the two came first. Shots' numbers wrap, start again, and show how many are missing.
"""

import heapq
import math
import zlib
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError, Message
from wlsonar import range_image_protocol as rip

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.sonar.packets import LARGEST_PACKET

STRENGTH = rip.BitmapImageType.SIGNAL_STRENGTH_IMAGE
_LINEAR = np.where(np.arange(256) > 0, 30.0 * 10.0 ** (np.arange(256) / 100.0), 0.0)  # strength of every level
_SNAPPY_RATIO = 22  # Snappy's longest copy is of 64 bytes, and takes three
REACH = 16  # shots that a packet may come too late
WAITING = REACH + 1  # shots that wait: with fewer, a shot that comes late leaves before its strength image
_EARLY = 2 * REACH  # strength images that wait for their range image
_RANGE = 1 << 32  # sequence_id is a uint32, and begins at 0 again
_MOST_MISSING = 1 << 16  # in a row; more is another count of a sonar that was restarted
_REMEMBERED = 1 << 16


def message_of(content: bytes, *kinds: type[Message]) -> Message | None:
    """The message of a packet whose checksum is right, of one of the `kinds` of wlsonar; None for another kind."""
    try:
        _require_believable(content)
        return rip.unpackb(content, known_message_types=kinds, max_packet_size=LARGEST_PACKET)
    except rip.UnknownProtobufTypeError:
        return None  # the protocol says to skip what is not documented
    except (ValueError, DecodeError) as error:
        raise InputError(f"is damaged ({error})") from error


def _require_believable(packet: bytes) -> None:
    """Refuse a Snappy block that claims more than its bytes can hold, before room is made for it."""
    if packet.startswith(b"RIP1"):
        return  # not compressed
    claimed = 0
    for place, byte in enumerate(packet[8:13]):
        claimed |= (byte & 0x7F) << (7 * place)
        if byte < 0x80:
            break
    if claimed > _SNAPPY_RATIO * len(packet):
        raise ValueError(f"{len(packet):,} bytes claim to unpack to {claimed:,}")


@dataclass(frozen=True, slots=True)
class Frame:
    """A range image."""

    number: int  # the sonar's number of its shot, 0 to 2^32 - 1
    stamp: float | None  # when, by the sonar's clock [s, UTC]; None where it is not said
    points: np.ndarray  # (N, 3) float64 [m], x forward, y left, z up
    pixels: np.ndarray  # (N,) of the image's, row by row, where the points are
    shape: tuple[int, int]  # width and height of the image
    sound_speed: float | None  # with which the sonar computed ranges [m/s]; None where it is not said


def frame_of(image: rip.RangeImage) -> Frame:
    """Raises InputError: an image that contradicts itself."""
    width, height, scale = image.width, image.height, image.image_pixel_scale
    fields = (image.fov_horizontal, image.fov_vertical)
    # A scale that is NaN spoils this frame alone: its points are NaN, and told as such.
    if not all(0 < fov <= 360 for fov in fields) or not (0 < scale < math.inf or math.isnan(scale)):
        raise InputError(f"is a range image with fields of view {fields} degrees and scale {scale} m, wanted above 0")
    values = np.fromiter(image.image_pixel_data, np.uint32)
    if len(values) != width * height:
        raise InputError(f"is a range image of {width} x {height} with {len(values):,} pixels")
    pixels = np.flatnonzero(values != 0)
    ranges = values[pixels].astype(np.float64) * scale
    points = ranges[:, None] * _directions(width, height, *fields).take(pixels, axis=0)
    speed = image.speed_of_sound if 0 < image.speed_of_sound < math.inf else None
    return Frame(image.header.sequence_id, stamp_of(image), points, pixels, (width, height), speed)


@lru_cache(maxsize=2)
def _directions(width: int, height: int, horizontal: float, vertical: float) -> np.ndarray:
    """(width * height, 3) of the pixels, x forward, y left, z up; fields of view in degrees."""
    row, column = np.divmod(np.arange(width * height), max(width, 1))
    yaw = math.radians(horizontal) * (column / max(width - 1, 1) - 0.5)  # to the right
    pitch = math.radians(vertical) * (row / max(height - 1, 1) - 0.5)  # upwards: row 0 is the lowest
    return np.stack([np.cos(pitch) * np.cos(yaw), -np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=1)


def stamp_of(image: Any) -> float | None:
    """Seconds in UTC by the sonar's clock; None where the message has no time."""
    if not image.header.HasField("timestamp"):
        return None
    return image.header.timestamp.seconds + image.header.timestamp.nanos * 1e-9


def strength_of(frame: Frame, image: rip.BitmapImageGreyscale8) -> np.ndarray:
    """(N,) float64 linear strength of each of the frame's points, 30 x 10^(v / 100), 0 where there is none."""
    levels = np.frombuffer(image.image_pixel_data, np.uint8)
    if (image.width, image.height) != frame.shape or len(levels) != image.width * image.height:
        raise InputError(
            f"is a strength image of {image.width} x {image.height} with {len(levels):,} pixels beside a range image "
            f"of {frame.shape[0]} x {frame.shape[1]}"
        )
    return _LINEAR[levels[frame.pixels]]


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
        """A range image has come."""
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
        """A strength image has come."""
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
