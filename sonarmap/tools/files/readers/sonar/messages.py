"""A packet's message, decoded by wlsonar; the pixels of a range image are decoded here, at once, to points.

The device looks along x with y to the right and z DOWN (wlsonar, Range Image Protocol RIP2); the points are turned
here, once, to x forward, y left, z up.
"""

import math
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np
from google.protobuf import any_pb2, descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.message import DecodeError, Message
from wlsonar import range_image_protocol as rip

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.sonar.packets import LARGEST_PACKET

STRENGTH = rip.BitmapImageType.SIGNAL_STRENGTH_IMAGE
_LINEAR = np.where(np.arange(256) > 0, 30.0 * 10.0 ** (np.arange(256) / 100.0), 0.0)  # strength of every level
_SNAPPY_RATIO = 22  # Snappy's longest copy is of 64 bytes, and takes three
_PIXELS = "image_pixel_data"
_LONGEST = 3  # bytes that a number of 16 bits takes


def message_of(content: bytes, *kinds: type[Message]) -> Message | None:
    """The message of a packet whose checksum is right, of one of the `kinds` (`range_image_type()` and those of
    wlsonar); None for another kind. Raises InputError: what is packed in it is damaged; the message says how."""
    try:
        _require_believable(content)
        return rip.unpackb(content, known_message_types=kinds, max_packet_size=LARGEST_PACKET)
    except rip.UnknownProtobufTypeError:
        return None  # the protocol says to skip what is not documented
    except (ValueError, DecodeError) as error:
        raise InputError(f"is damaged ({error})") from error


@cache
def range_image_type() -> type[Message]:
    """wlsonar's RangeImage, but for its pixels, which stay the bytes that were sent: of each Python makes an object
    otherwise, which takes longer than all else."""
    file = descriptor_pb2.FileDescriptorProto()
    rip.RangeImage.DESCRIPTOR.file.CopyToProto(file)
    image = next(message for message in file.message_type if message.name == rip.RangeImage.DESCRIPTOR.name)
    pixels = next(field for field in image.field if field.name == _PIXELS)
    pixels.type = pixels.TYPE_BYTES  # repeated, as a sender may divide them
    pixels.ClearField("options")
    pool = descriptor_pool.DescriptorPool()
    for needed in (any_pb2, timestamp_pb2):
        pool.AddSerializedFile(needed.DESCRIPTOR.serialized_pb)
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(rip.RangeImage.DESCRIPTOR.full_name))


def pixels_of(image: Message) -> np.ndarray:
    """(N,) uint32, the pixels of a message of `range_image_type()`, row by row. Raises InputError: bytes that are no
    numbers."""
    pixels = _short_varints(b"".join(getattr(image, _PIXELS)))
    if pixels is None or len(pixels) != image.width * image.height:  # type: ignore[attr-defined]
        try:  # numbers of other lengths, or each in a field of its own, which a sender may choose
            pixels = np.array(getattr(rip.RangeImage.FromString(image.SerializeToString()), _PIXELS), np.uint32)
        except DecodeError as error:
            raise InputError(f"is damaged ({error})") from error
    return pixels


def _short_varints(content: bytes) -> np.ndarray | None:
    """(N,) uint32 numbers of seven bits to a byte, the lowest first; None where one is long or the last is cut."""
    octets = np.frombuffer(content, np.uint8)
    ends = np.flatnonzero(octets < 0x80)
    if not len(octets) or not len(ends) or ends[-1] != len(octets) - 1:
        return None
    lengths = np.diff(ends, prepend=-1)
    if lengths.max() > _LONGEST:
        return None
    starts = ends - lengths + 1
    bits = (octets & 0x7F).astype(np.uint32)
    numbers = bits[starts]
    for more in range(1, _LONGEST):
        (longer,) = np.nonzero(lengths > more)
        numbers[longer] |= bits[starts[longer] + more] << np.uint32(7 * more)
    return numbers


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
