"""Decodes messages of the types that are read here; their definitions are the same in all releases of ROS."""

from functools import cache
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags.recording import Message, refused

POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
FOXGLOVE_CLOUD = "foxglove.PointCloud"


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
