"""A packet's message, decoded by wlsonar; only the pixels of a range image are decoded here, at once."""

from functools import cache

import numpy as np
from google.protobuf import any_pb2, descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.message import DecodeError, Message
from wlsonar import range_image_protocol as rip

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.sonar.packets import LARGEST_PACKET

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
