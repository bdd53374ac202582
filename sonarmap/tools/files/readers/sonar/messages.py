"""Messages of packets, decoded by wlsonar, and the shots of a recording in order.

The pixels of a range image are converted to points here. The device looks along x with y to the right and z DOWN
(wlsonar, Range Image Protocol RIP2); the points have x forward, y left, z up. A shot is joined with its strength image,
whichever comes first. The numbers of shots may wrap or start again, and show how many shots are missing.
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
_SNAPPY_RATIO = 22  # largest compression: Snappy's longest copy has 64 bytes and takes three
REACH = 16  # largest delay of a packet [shots]
WAITING = REACH + 1  # shots in the queue: with fewer, a late shot would leave before its strength image
_EARLY = 2 * REACH  # strength images that wait for their range image
_RANGE = 1 << 32  # sequence_id is a uint32, and wraps to 0
_MAX_MISSING = 1 << 16  # consecutive shots; after more, the sonar was restarted
_REMEMBERED = 1 << 16  # keys


def message_of(content: bytes, *kinds: type[Message]) -> Message | None:
    """The message of a packet with a right checksum, if it is of one of the `kinds` of wlsonar, else None."""
    try:
        _require_believable(content)
        return rip.unpackb(content, known_message_types=kinds, max_packet_size=LARGEST_PACKET)
    except rip.UnknownProtobufTypeError:
        return None  # the protocol says to skip undocumented types
    except (ValueError, DecodeError) as error:
        raise InputError(f"is damaged ({error})") from error


def _require_believable(packet: bytes) -> None:
    """Refuse a Snappy block whose claimed size exceeds what its bytes can hold, before memory is allocated."""
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

    number: int  # of its shot, 0 to 2^32 - 1
    stamp: float | None  # by the sonar's clock [s, UTC]; None if unknown
    points: np.ndarray  # (N, 3) float64 [m], x forward, y left, z up
    pixels: np.ndarray  # (N,) int64 row-major indices of the points' pixels
    shape: tuple[int, int]  # width and height of the image
    sound_speed: float | None  # with which the sonar computed ranges [m/s]; None if unknown


def frame_of(image: rip.RangeImage) -> Frame:
    """Convert a range image to points; an inconsistent one raises InputError."""
    width, height, scale = image.width, image.height, image.image_pixel_scale
    fields = (image.fov_horizontal, image.fov_vertical)
    # A scale that is NaN is accepted: the points of this frame are NaN, and reported as such.
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
    """(width * height, 3) unit vectors of the pixels, x forward, y left, z up; fields of view in degrees."""
    row, column = np.divmod(np.arange(width * height), max(width, 1))
    yaw = math.radians(horizontal) * (column / max(width - 1, 1) - 0.5)  # to the right
    pitch = math.radians(vertical) * (row / max(height - 1, 1) - 0.5)  # upward: row 0 is the lowest
    return np.stack([np.cos(pitch) * np.cos(yaw), -np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=1)


def stamp_of(image: Any) -> float | None:
    """The stamp by the sonar's clock [s, UTC]; None if the message has no time."""
    if not image.header.HasField("timestamp"):
        return None
    return image.header.timestamp.seconds + image.header.timestamp.nanos * 1e-9


def strength_of(frame: Frame, image: rip.BitmapImageGreyscale8) -> np.ndarray:
    """(N,) float64 linear strength of the frame's points, 30 x 10^(v / 100) of level v, 0 for level 0."""
    levels = np.frombuffer(image.image_pixel_data, np.uint8)
    if (image.width, image.height) != frame.shape or len(levels) != image.width * image.height:
        raise InputError(
            f"is a strength image of {image.width} x {image.height} with {len(levels):,} pixels beside a range image "
            f"of {frame.shape[0]} x {frame.shape[1]}"
        )
    return _LINEAR[levels[frame.pixels]]


class ShotNumbers:
    """Order of shots from their wrapping numbers, and counts: `late` shots, which came after a later one, `wraps` of
    the numbers, and `restarts` of the count. A decrease by more than half of 2^32 is a wrap, one by at most `REACH` a
    late packet, and any other a restart of the sonar."""

    def __init__(self) -> None:
        self.late = self.wraps = self.restarts = 0
        self._missing_before = self._count = 0
        self._number = self._place = self._lowest = 0  # of the latest shot; place of the first since a restart
        self._stamp: float | None = None

    @property
    def missing(self) -> int:
        """Number of missing shots between the first and the last one of each restart."""
        return self._missing_before + (self._place - self._lowest + 1 - self._count if self._count else 0)

    def place(self, number: int, stamp: float | None) -> int:
        """Place of a new shot in the recording, from its number, 0 to 2^32 - 1, and its stamp [s]: ascending in the
        order in which shots were taken, by 1 if none is missing."""
        step = (number - self._number + _RANGE // 2) % _RANGE - _RANGE // 2
        is_later = stamp is not None and self._stamp is not None and stamp > self._stamp
        if self._count and -REACH <= step < 0 and not is_later:
            self.late += 1
            self._count += 1
            self._lowest = min(self._lowest, self._place + step)
            return self._place + step
        if self._count and 0 < step <= _MAX_MISSING:
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
        self._place += 2 * REACH  # late shots still fit between the earlier shots and it
        self._lowest, self._count = self._place, 1


class Remembered:
    """The latest keys, at most `most`, to recognize duplicates."""

    def __init__(self, most: int = _REMEMBERED) -> None:
        self._keys: dict[Hashable, None] = {}
        self._most = most

    def is_new(self, key: Hashable) -> bool:
        """Whether the key is not remembered; it is added, and the oldest one is forgotten if there are too many."""
        is_new = key not in self._keys
        self._keys.setdefault(key)
        if len(self._keys) > self._most:
            del self._keys[next(iter(self._keys))]
        return is_new


@dataclass(frozen=True, slots=True)
class Shot:
    """A range image with its strengths."""

    place: int  # ascending from shot to shot, by 1 if none is missing
    frame: Frame  # the range image
    strength: np.ndarray | None = None  # (N,) float64 linear echo strength of the frame's points, or None


class ShotQueue:
    """Shots wait here for their strength images and for late shots, until `WAITING` others follow. `doubled`: number of
    images that came twice and were left out; `alone`: number of strength images whose range image never came."""

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
        """Add a range image."""
        if not self._frames.is_new((frame.number, frame.stamp or zlib.crc32(frame.points.tobytes()))):
            self.doubled += 1
            return
        arrival = next(self._arrivals)
        place = self.numbers.place(frame.number, frame.stamp)
        self._shots[arrival] = Shot(place, frame)
        self._latest[frame.number] = arrival
        heapq.heappush(self._order, (place, arrival))
        image = self._early.get(frame.number)
        if image is not None and _of_one_shot(frame, image):
            del self._early[frame.number]
            self._join(arrival, image)

    def add_strength(self, image: rip.BitmapImageGreyscale8) -> None:
        """Add a strength image."""
        number = image.header.sequence_id
        if not self._strengths.is_new((number, stamp_of(image) or zlib.crc32(image.image_pixel_data))):
            self.doubled += 1
            return
        arrival = self._latest.get(number)
        if arrival is not None and _of_one_shot(self._shots[arrival].frame, image):
            self._join(arrival, image)
            return
        self.alone += self._early.pop(number, None) is not None
        self._early[number] = image
        if len(self._early) > _EARLY:
            del self._early[next(iter(self._early))]
            self.alone += 1

    def shots(self, waiting: int) -> Iterator[Shot]:
        """Shots in order, until only `waiting` are left in the queue."""
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


def _of_one_shot(frame: Frame, image: rip.BitmapImageGreyscale8) -> bool:
    """Whether two images with one number are of one shot: numbers may start again."""
    stamp = stamp_of(image)
    return stamp is None or frame.stamp is None or stamp == frame.stamp
