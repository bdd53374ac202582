"""A range image's points and strengths.

The device looks along x with y to the right and z DOWN (wlsonar, Range Image Protocol RIP2); the points are turned
here, once, to x forward, y left, z up.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from wlsonar import range_image_protocol as rip

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.sonar.messages import pixels_of

STRENGTH = rip.BitmapImageType.SIGNAL_STRENGTH_IMAGE
_LINEAR = np.where(np.arange(256) > 0, 30.0 * 10.0 ** (np.arange(256) / 100.0), 0.0)  # strength of every level


@dataclass(frozen=True, slots=True)
class Frame:
    """A range image."""

    number: int  # the sonar's number of its shot, 0 to 2^32 - 1
    stamp: float | None  # when, by the sonar's clock [s, UTC]; None where it is not said
    points: np.ndarray  # (N, 3) float64 [m], x forward, y left, z up
    pixels: np.ndarray  # (N,) of the image's, row by row, where the points are
    shape: tuple[int, int]  # width and height of the image
    sound_speed: float | None  # with which the sonar computed ranges [m/s]; None where it is not said


def frame_of(image: Any) -> Frame:
    """The points of a message of `range_image_type()`. Raises InputError: an image that contradicts itself."""
    width, height, scale = image.width, image.height, image.image_pixel_scale
    fields = (image.fov_horizontal, image.fov_vertical)
    # A scale that is NaN spoils this frame alone: its points are NaN, and told as such.
    if not all(0 < fov <= 360 for fov in fields) or not (0 < scale < math.inf or math.isnan(scale)):
        raise InputError(f"is a range image with fields of view {fields} degrees and scale {scale} m, wanted above 0")
    values = pixels_of(image)
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
    """(N,) float64 linear strength of each of the frame's points, 30 x 10^(v / 100), 0 where there is none. Raises
    InputError: the image is of another size than the frame's."""
    levels = np.frombuffer(image.image_pixel_data, np.uint8)
    if (image.width, image.height) != frame.shape or len(levels) != image.width * image.height:
        raise InputError(
            f"is a strength image of {image.width} x {image.height} with {len(levels):,} pixels beside a range image "
            f"of {frame.shape[0]} x {frame.shape[1]}"
        )
    return _LINEAR[levels[frame.pixels]]
