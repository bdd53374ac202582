"""A recording of messages on topics, independent of its file format; decoding of messages, and limited unpacking.

Compressed data is unpacked only up to a plausible size of a message, chunk or file.
"""

import bz2
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from io import BufferedReader, BytesIO, FileIO
from pathlib import Path
from typing import Any
from weakref import finalize

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.rows import most_unpacked

CUT_OR_DAMAGED = "the recording is cut or damaged there; copy it again"
_LISTED = 12  # topics that a message lists
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
FOXGLOVE_CLOUD = "foxglove.PointCloud"
LARGEST = 1 << 29  # largest unpacked chunk [bytes]; recorders write a few MB each
ZSTD_START = b"\x28\xb5\x2f\xfd"
_PIECE = 1 << 22
NOT_BELIEVABLE = "which is not believable for its size: the recording is damaged; copy it again"
_NO_RECORDING = "which no recorder writes: the recording is damaged; copy it again"
_ALL = 1000  # largest ratio of the unpacked size of all chunks, in one pass, to the file's size
_FEW, _RECORD = 1 << 17, 4  # records that any file may hold, and fewest bytes per record beyond (real ones take tens)
_OF_FREE = 0.9  # share of a disk's free space that may be used


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic's name, the type of its messages (as sensor_msgs/msg/PointCloud2), and their number."""

    name: str
    kind: str
    count: int


@dataclass(frozen=True, slots=True)
class Message:
    """A recorded message, not decoded yet."""

    topic: str  # name of its topic
    kind: str  # type of the message
    time: int  # time of recording [ns since 1970]
    content: bytes
    encoding: str  # of the content: ros1, cdr or protobuf
    schema: bytes = b""  # schema for protobuf


# Yields the messages of topics with some names in chronological order; damage is appended to the list of faults.
ReadMessages = Callable[[Collection[str], list[str]], Iterator[Message]]


@dataclass(frozen=True, slots=True)
class Recording:
    """The topics of a recording, and its messages, which are read one by one with every call of `messages`."""

    topics: tuple[Topic, ...]
    messages: ReadMessages

    def of_kinds(self, kinds: Collection[str]) -> list[Topic]:
        """The topics that have messages of the types `kinds`."""
        return [topic for topic in self.topics if topic.kind in kinds and topic.count]


def choose_topic(recording: Recording, name: str | None, kinds: Collection[str], path: object) -> Topic:
    """The topic `name`, or without a name the only topic with messages of the types `kinds`."""
    candidates = recording.of_kinds(kinds)
    wanted = " or ".join(kinds)
    if name is None:
        if len(candidates) == 1:
            return candidates[0]
        if candidates:
            words = f"it has {len(candidates)} topics of {wanted}: {listed(candidates)}"
            raise InputError(f"{words}; choose one, as in {path}::{candidates[0].name}")
        raise InputError(f"it has no messages of type {wanted}; its topics are {listed(recording.topics)}")
    topic = next((topic for topic in recording.topics if topic.name.lstrip("/") == name.lstrip("/")), None)
    if topic is None:
        raise InputError(f"it has no topic {name}; its topics are {listed(recording.topics)}")
    if topic not in candidates:
        raise InputError(
            f"its topic {topic.name} has {topic.count:,} messages of type {topic.kind}; wanted {wanted}: "
            f"{listed(candidates)}"
        )
    return topic


def listed(topics: Sequence[Topic]) -> str:
    words = [f"{topic.name} ({topic.count:,} of {topic.kind})" for topic in topics[:_LISTED]]
    return ", ".join(words + ["..."] * (len(topics) > _LISTED)) or "(none)"


@contextmanager
def refused(what: str) -> Iterator[None]:
    """Turn any exception of a library in the block into an InputError whose message begins with `what`."""
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:  # libraries raise anything for damaged files
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{what} ({reason[:200]}): {CUT_OR_DAMAGED}") from error


def stamp_of(header: Any) -> int:
    """The stamp of a ROS header [ns since 1970]; 0 if it has none."""
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def topics_of(counts: Mapping[tuple[str, str], int]) -> tuple[Topic, ...]:
    """Topics, sorted by name, from {(name, type): count}."""
    return tuple(Topic(name, kind, count) for (name, kind), count in sorted(counts.items()))


def decode(message: Message) -> Any:
    """The decoded content of a message, with the fields of its type as attributes."""
    encoding = message.encoding
    with refused(f"its {message.kind} cannot be decoded"):
        if encoding == "cdr":
            return _types("ros2_humble").deserialize_cdr(message.content, message.kind)
        if encoding == "ros1":
            return _types("ros1_noetic").deserialize_ros1(message.content, message.kind)
        if encoding == "protobuf":
            return _protobuf_class(message.kind, message.schema).FromString(message.content)
    raise InputError(f"its {message.kind} is encoded as {encoding[:40]!r}; wanted cdr, ros1 or protobuf")


@cache
def _types(release: str) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores(release))
    if TRANSFORMS not in types.types:
        types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS))
    return types


@cache
def _protobuf_class(kind: str, schema: bytes) -> Any:
    """The class of a message type, from the schema in the file."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(kind))


@dataclass(slots=True)
class Unpacker:
    """Unpacks the chunks of one file, with size limits for each chunk and for all of them."""

    size: int  # of the file [bytes]
    plain: int = 0  # bytes unpacked

    def __call__(self, content: bytes, compression: str) -> bytes:
        """The plain bytes of a chunk. `compression`: none (or empty), bz2, lz4 (frames) or zstd."""
        if compression in ("", "none"):
            return content
        if self.plain > max(LARGEST, _ALL * self.size):
            raise InputError(f"its {self.size:,} bytes unpack to more than {self.plain:,}, {_NO_RECORDING}")
        most = min(LARGEST, most_unpacked(len(content)))
        plain = bytearray()
        with _stream(content, compression) as stream:
            while piece := stream.read(_PIECE):
                plain += piece
                self.plain += len(piece)
                if len(plain) > most:
                    raise InputError(f"{compression} unpacks to more than {most:,} bytes, {_NO_RECORDING}")
        return bytes(plain)


def _stream(content: bytes, compression: str) -> Any:
    """A stream of the plain bytes, to be read in pieces: the libraries allocate as much as a read requests."""
    match compression:
        case "zstd":
            import zstandard

            return zstandard.ZstdDecompressor().stream_reader(content, read_across_frames=True)
        case "bz2":
            return bz2.BZ2File(BytesIO(content))
        case "lz4":
            import lz4.frame

            return lz4.frame.LZ4FrameFile(BytesIO(content))
    raise InputError(f"its compression is {compression[:40]!r}; wanted bz2, lz4 or zstd: write the recording again")


class HeldBytes(BufferedReader):
    """A file that limits every read to the bytes it holds: libraries would allocate memory for any length that
    a damaged file claims."""

    def __init__(self, path: Path) -> None:
        super().__init__(FileIO(path))
        self._size = path.stat().st_size

    def read(self, size: int | None = -1) -> bytes:
        """Read at most `size` bytes, and no more than remain in the file."""
        remaining = max(self._size - self.tell(), 0)
        return super().read(remaining if size is None or size < 0 else min(size, remaining))


def most_records(packed: int) -> int:
    """The largest plausible number of records in a file of `packed` bytes."""
    return max(_FEW, packed // _RECORD)


class Room:
    """A temporary folder for the unpacked files of one bag, removed with the last reference to it. `packed`: total size
    of the compressed files [bytes]."""

    def __init__(self, packed: int) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="sonarmap."))
        finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        self._most, self._free = most_unpacked(packed), int(shutil.disk_usage(self._folder).free * _OF_FREE)
        self._written = 0

    def unpack(self, path: Path) -> Path:
        """Unpack a file NAME.db3.zstd or NAME.mcap.zstd; return the path of the unpacked file."""
        import zstandard

        plain, yourself = self._folder / path.stem, f"unpack it yourself with zstd -d {path.name}"
        try:
            with (
                path.open("rb") as file,
                zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True) as packed,
                plain.open("wb") as out,
            ):
                while piece := packed.read(_PIECE):
                    self._take(len(piece), yourself)
                    out.write(piece)
        except zstandard.ZstdError as error:
            raise InputError(f"it cannot be unpacked ({error}); copy it again") from error
        except OSError as error:
            raise InputError(
                f"{tempfile.gettempdir()} cannot hold it ({error.strerror or error}); make room there, or {yourself}"
            ) from error
        return plain

    def _take(self, more: int, yourself: str) -> None:
        self._written += more
        if self._written > self._most:
            raise InputError(f"the bag unpacks to more than {self._most:,} bytes, {_NO_RECORDING}, or {yourself}")
        if self._written > self._free:
            raise InputError(
                f"the bag unpacks to more than the {self._free:,} bytes available in {tempfile.gettempdir()}; "
                f"make room there, or {yourself} elsewhere"
            )
