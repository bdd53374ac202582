"""A recording of messages on topics, whatever file it comes from, and what a message of the known types holds."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any

from sonarmap.kernels.errors import InputError

CUT_OR_DAMAGED = "the recording is cut or damaged there; copy it again"
_LISTED = 12  # topics that a message lists
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
ODOMETRY = "nav_msgs/msg/Odometry"
IMU = "sensor_msgs/msg/Imu"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
FOXGLOVE_CLOUD = "foxglove.PointCloud"


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic's name, the type of its messages (as sensor_msgs/msg/PointCloud2), and how many there are."""

    name: str
    kind: str
    count: int


@dataclass(frozen=True, slots=True)
class Message:
    """A message as it was recorded, not decoded yet."""

    topic: str  # topic, kind: its topic's name and type
    kind: str
    time: int  # when it was recorded [ns since 1970]
    content: bytes  # its bytes
    encoding: str  # of the content: ros1, cdr or protobuf
    schema: bytes = b""  # what protobuf needs to decode it


# The messages of topics with some names, in the order of their times; what is damaged is added to the list of faults.
ReadMessages = Callable[[Collection[str], list[str]], Iterator[Message]]


@dataclass(frozen=True, slots=True)
class Recording:
    """The topics of a recording, and its messages, which are read one by one and as often as they are asked for."""

    topics: tuple[Topic, ...]
    messages: ReadMessages

    def of_kinds(self, kinds: Collection[str]) -> list[Topic]:
        """The topics with messages of some types."""
        return [topic for topic in self.topics if topic.kind in kinds and topic.count]


def choose_topic(recording: Recording, name: str | None, kinds: Collection[str], path: object) -> Topic:
    """The topic of that name, or the only one with messages of some types. Raises InputError: no such topic, one of
    another type, or several of which none is named."""
    able = recording.of_kinds(kinds)
    wanted = " or ".join(kinds)
    if name is None:
        if len(able) == 1:
            return able[0]
        if able:
            raise InputError(
                f"it has {len(able)} topics of {wanted}: {listed(able)}; choose one, as in {path}::{able[0].name}"
            )
        raise InputError(f"it has no messages of type {wanted}; its topics are {listed(recording.topics)}")
    known = [topic for topic in recording.topics if topic.name.lstrip("/") == name.lstrip("/")]
    if not known:
        raise InputError(f"it has no topic {name}; its topics are {listed(recording.topics)}")
    if known[0] not in able:
        raise InputError(
            f"its topic {known[0].name} has {known[0].count:,} messages of type {known[0].kind}; wanted {wanted}: "
            f"{listed(able)}"
        )
    return known[0]


def listed(topics: Sequence[Topic]) -> str:
    """Topics with their types and counts, for a message."""
    words = [f"{topic.name} ({topic.count:,} of {topic.kind})" for topic in topics[:_LISTED]]
    return ", ".join(words + ["..."] * (len(topics) > _LISTED)) or "(none)"


@contextmanager
def refused(what: str) -> Iterator[None]:
    """Whatever a library stumbles over in the block is an error in words that begin with `what`."""
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:  # libraries answer damage with errors of any kind
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{what} ({reason[:200]}): {CUT_OR_DAMAGED}") from error


def topics_of(counts: Mapping[tuple[str, str], int]) -> tuple[Topic, ...]:
    """Topics from {(name, type): count}, in order of their names."""
    return tuple(Topic(name, kind, count) for (name, kind), count in sorted(counts.items()))


def decode(message: Message) -> Any:
    """The content of a message, with the fields of its type as attributes. Raises InputError: another type or encoding,
    or damaged content."""
    encoding = message.encoding
    with refused(f"its {message.kind} cannot be decoded"):
        if encoding == "cdr":
            return _types("ros2_humble").deserialize_cdr(message.content, message.kind)
        if encoding == "ros1":
            return _types("ros1_noetic").deserialize_ros1(message.content, message.kind)
        if encoding == "protobuf":
            return _protobuf_class(message.kind, message.schema).FromString(message.content)
    raise InputError(
        f"its {message.kind} is encoded as {encoding[:40]!r}; wanted cdr, ros1 or protobuf: record it again"
    )


@cache
def _types(release: str) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores(release))
    if TRANSFORMS not in types.types:
        types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS))
    return types


@cache
def _protobuf_class(kind: str, schema: bytes) -> Any:
    """Of a message's type, as the schema in the file defines it."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(kind))
