"""Recordings written by rosbags and by the MCAP project's own libraries."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer as McapRos2Writer
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tests.samples.bags.messages import TF

# Topic, type, time at which it was recorded [s], the message.
Record = tuple[str, str, float, dict[str, Any]]


@cache
def types(release: Stores) -> Any:
    """The types of a release, with those of tf."""
    store = get_typestore(release)
    if TF not in store.types:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return store


def built(store: Any, kind: str, value: dict[str, Any]) -> Any:
    """The message of rosbags for a dictionary; missing fields are 0."""
    return store.types[kind](**{name: _field(store, form, value.get(name)) for name, form in store.fielddefs[kind][1]})


def _field(store: Any, form: Any, value: Any) -> Any:
    node, argument = form
    if node == Nodetype.NAME:
        return built(store, argument, value or {})
    if node == Nodetype.BASE:
        return value if value is not None else {"string": "", "bool": False}.get(argument[0], 0)
    inner, length = argument
    if inner[0] == Nodetype.NAME:
        return [built(store, inner[1], item) for item in value or []]
    if isinstance(value, list):
        return np.array(value, inner[1][0])
    return np.zeros(length, inner[1][0]) if value is None else np.frombuffer(value, inner[1][0])


def write_ros1(path: Path, records: Sequence[Record], compression: str = "") -> Path:
    """A ROS 1 bag; compression is bz2, lz4 or none."""
    store = types(Stores.ROS1_NOETIC)
    writer = Writer1(path)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    with writer:
        _write_records(writer, records, store, store.serialize_ros1)
    return path


def write_ros2(folder: Path, records: Sequence[Record], mcap: bool = False, compression: str = "") -> Path:
    """A ROS 2 bag in a folder; compression is none, or by file, message or storage."""
    store = types(Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    writer = Writer2(folder, version=9, storage_plugin=plugin)
    if compression:
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with writer:
        _write_records(writer, records, store, store.serialize_cdr)
    return folder


def _write_records(writer: Any, records: Sequence[Record], store: Any, serialize: Callable[..., Any]) -> None:
    """Write every record on the connection of its topic."""
    topics = _first_of_each(records)
    connections = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind, *_ in topics}
    for topic, kind, time, message in records:
        writer.write(connections[topic], round(time * 1e9), bytes(serialize(built(store, kind, message), kind)))


def write_mcap(path: Path, records: Sequence[Record], **options: Any) -> Path:
    """An MCAP file by the MCAP project's writer for ROS 2, with its own encoder."""
    with path.open("wb") as file:
        writer = McapRos2Writer(file, **options)
        schemas = {kind: writer.register_msgdef(kind, _definition(kind)) for _, kind, *_ in records}
        for topic, kind, time, message in records:
            writer.write_message(topic, schemas[kind], message, log_time=round(time * 1e9))
        writer.finish()
    return path


def _definition(kind: str) -> str:
    return types(Stores.ROS2_HUMBLE).generate_msgdef(kind, ros_version=2)[0]


def _first_of_each(records: Sequence[Record]) -> list[Record]:
    return list({record[0]: record for record in reversed(records)}.values())


WRITERS: dict[str, Callable[[Path, Sequence[Record]], Path]] = {
    "ros1": lambda folder, records: write_ros1(folder / "dive.bag", records),
    "ros1 bz2": lambda folder, records: write_ros1(folder / "dive.bag", records, "bz2"),
    "ros1 lz4": lambda folder, records: write_ros1(folder / "dive.bag", records, "lz4"),
    "sqlite": lambda folder, records: write_ros2(folder / "dive", records),
    "sqlite by message": lambda folder, records: write_ros2(folder / "dive", records, compression="message"),
    "sqlite by file": lambda folder, records: write_ros2(folder / "dive", records, compression="file"),
    "sqlite alone": lambda folder, records: write_ros2(folder / "dive", records) / "dive.db3",
    "ros2 mcap": lambda folder, records: write_ros2(folder / "dive", records, mcap=True),
    "ros2 mcap zstd": lambda folder, records: write_ros2(folder / "dive", records, mcap=True, compression="storage"),
    "mcap": lambda folder, records: write_mcap(folder / "dive.mcap", records),
    "mcap plain": lambda folder, records: write_mcap(folder / "dive.mcap", records, compression=CompressionType.NONE),
    "mcap lz4": lambda folder, records: write_mcap(folder / "dive.mcap", records, compression=CompressionType.LZ4),
    "mcap of small chunks": lambda folder, records: write_mcap(folder / "dive.mcap", records, chunk_size=100),
}
