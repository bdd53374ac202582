"""ROS 1 bags, format 2.0, by rosbags: through their index, chunk by chunk."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from kernels.errors import InputError
from tools.readers.bags.recording import Message, Recording, refused, topics_of
from tools.readers.bags.unpack import unpacked

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader


def open_ros1(path: Path) -> Recording:
    """The recording of a ROS 1 bag.

    Raises:
        InputError: its index is missing or damaged.
    """
    counts: Counter[tuple[str, str]] = Counter()
    with _opened(path) as reader:
        for connection in reader.connections:
            counts[connection.topic, connection.msgtype] += connection.msgcount
    return Recording(topics_of(counts), partial(_messages, path))


def _messages(path: Path, names: Collection[str], faults: list[str]) -> Iterator[Message]:
    with _opened(path) as reader:
        wanted = [connection for connection in reader.connections if connection.topic in names]
        messages = reader.messages(wanted) if wanted else iter(())
        while True:
            try:
                with refused("a message of it cannot be read"):
                    entry = next(messages, None)
            except InputError as error:
                faults.append(f"{error}; what follows is missing")
                return
            if entry is None:
                return
            connection, time, content = entry
            yield Message(connection.topic, connection.msgtype, time, content, "ros1")


@contextmanager
def _opened(path: Path) -> Iterator[Reader]:
    """The bag with its index, and chunks that unpack to a limit."""
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import decompressors

    names = {decompressor: name for name, decompressor in decompressors.items()}
    reader = Reader(path)
    with refused("its index cannot be read; `rosbag reindex` makes another"):
        reader.open()
        for place, chunk in reader.chunks.items():
            limited = partial(unpacked, compression=names[chunk.decompressor])
            reader.chunks[place] = chunk._replace(decompressor=limited)
    try:
        yield reader
    finally:
        reader.close()
