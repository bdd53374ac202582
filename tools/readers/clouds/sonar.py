"""Recordings of the Water Linked Sonar 3D-15 (.sonar): one scan per range image, strengths from its twin.

The device looks along x with y to the right and z DOWN (wlsonar, Range Image Protocol RIP2); the points are
turned here, once, to x forward, y left, z up.
"""

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from google.protobuf.message import DecodeError, Message
from wlsonar import range_image_protocol as rip

from kernels.errors import InputError
from tools.readers.clouds.cloud import Cloud
from tools.readers.clouds.rows import shown

_LEAST_PACKET = 12  # magic, length and checksum, 4 bytes each
_STRENGTH = rip.BitmapImageType.SIGNAL_STRENGTH_IMAGE
_LARGEST_PACKET = 1 << 18  # four times what a datagram, in which the sonar sends it, can hold
_SNAPPY_RATIO = 22  # Snappy's longest copy is of 64 bytes, and takes three


@dataclass(frozen=True, slots=True)
class _Frame:
    """A range image's points, and the pixels (N,) they come from."""

    cloud: Cloud
    pixels: np.ndarray
    shape: tuple[int, int]


def read_sonar(content: bytes) -> list[Cloud]:
    """One cloud per range image, in the order of the file; one without an echo is empty.

    Raises:
        InputError: a damaged or cut packet (named), or images that contradict each other.
    """
    frames: list[_Frame] = []
    bare: dict[int, int] = {}  # sequence number -> frame without strength
    early: dict[int, rip.BitmapImageGreyscale8] = {}  # strength images that came before their range image
    for number, message in _messages(content):
        try:
            if isinstance(message, rip.RangeImage):
                sequence, frame = message.header.sequence_id, _frame_of(message)
                if sequence in early:
                    frame = _with_strength(frame, early.pop(sequence))
                else:
                    bare[sequence] = len(frames)
                frames.append(frame)
            elif isinstance(message, rip.BitmapImageGreyscale8) and message.type == _STRENGTH:
                sequence = message.header.sequence_id
                if sequence in bare:
                    index = bare.pop(sequence)
                    frames[index] = _with_strength(frames[index], message)
                else:
                    early[sequence] = message
        except InputError as error:
            raise InputError(f"packet {number}: {error}") from error
    if not frames:
        raise InputError("no range image among its packets; record with range images enabled")
    return [_noted_if_bare(frame.cloud, any_strength=len(bare) < len(frames)) for frame in frames]


def _noted_if_bare(cloud: Cloud, any_strength: bool) -> Cloud:
    if cloud.strength is not None or not any_strength:
        return cloud
    return replace(cloud, notes=("this frame has no strength image, other frames have one",))


def _messages(content: bytes) -> Iterator[tuple[int, Message]]:
    """Every message of a known type with its packet's number, from 1.

    Raises:
        InputError: naming the packet and its byte, where one is damaged or cut.
    """
    start = number = 0
    while start < len(content):
        number += 1
        where = f"packet {number} at byte {start:,}"
        header = content[start : start + 8]
        if len(header) < 8 or header[:4] not in (b"RIP1", b"RIP2"):
            raise InputError(
                f"{where} begins with {shown(header)}, wanted RIP2 and a length: the recording is cut or "
                "damaged there; copy it again, or cut it before that byte"
            )
        (length,) = struct.unpack_from("<I", header, 4)
        packet = content[start : start + length]
        if length < _LEAST_PACKET or len(packet) < length:
            raise InputError(
                f"{where} claims {length:,} bytes and {len(packet):,} are left: the recording is cut or "
                "damaged there; copy it again, or cut it before that byte"
            )
        try:
            _require_believable(packet)
            yield number, rip.unpackb(packet, max_packet_size=_LARGEST_PACKET)
        except rip.UnknownProtobufTypeError:
            pass  # the protocol says to skip what is not documented
        except (ValueError, DecodeError) as error:
            raise InputError(f"{where} is damaged ({error}); copy the recording again") from error
        start += length


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


def _frame_of(image: rip.RangeImage) -> _Frame:
    """The points of a range image, turned to x forward, y left, z up."""
    width, height, scale = image.width, image.height, image.image_pixel_scale
    fields = (image.fov_horizontal, image.fov_vertical)
    # A scale that is NaN spoils this frame alone: its points are NaN, and told as such.
    if not all(0 < fov <= 360 for fov in fields) or not (0 < scale < math.inf or math.isnan(scale)):
        raise InputError(
            f"a range image with fields of view {fields} degrees and scale {scale} m; "
            "wanted positive ones: copy the recording again"
        )
    ranges = np.array(image.image_pixel_data, dtype=np.float64) * scale
    if len(ranges) != width * height:
        raise InputError(f"a range image of {width} x {height} with {len(ranges):,} pixels; copy the recording again")
    (pixels,) = ranges.nonzero()
    row, column = np.divmod(pixels, max(width, 1))
    yaw = math.radians(image.fov_horizontal) * (column / max(width - 1, 1) - 0.5)  # to the right
    pitch = math.radians(image.fov_vertical) * (row / max(height - 1, 1) - 0.5)  # upwards: row 0 is the lowest
    r = ranges[pixels]
    points = np.stack([r * np.cos(pitch) * np.cos(yaw), -r * np.cos(pitch) * np.sin(yaw), r * np.sin(pitch)], axis=1)
    return _Frame(Cloud(points, stamp=_stamp_of(image)), pixels, (width, height))


def _stamp_of(image: rip.RangeImage) -> float | None:
    """Seconds in UTC by the sonar's clock; None where the packet carries no time."""
    if not image.header.HasField("timestamp"):
        return None
    return image.header.timestamp.seconds + image.header.timestamp.nanos * 1e-9


def _with_strength(frame: _Frame, image: rip.BitmapImageGreyscale8) -> _Frame:
    """The frame with the linear strength of each of its points, 30 x 10^(v / 100), 0 where there is none."""
    levels = np.frombuffer(image.image_pixel_data, np.uint8)
    if (image.width, image.height) != frame.shape or len(levels) != image.width * image.height:
        raise InputError(
            f"a strength image of {image.width} x {image.height} with {len(levels):,} pixels beside a range "
            f"image of {frame.shape[0]} x {frame.shape[1]}; copy the recording again"
        )
    level = levels[frame.pixels].astype(np.float64)
    strength = np.where(level > 0, 30.0 * 10.0 ** (level / 100.0), 0.0)
    return replace(frame, cloud=replace(frame.cloud, strength=strength))
