"""The SQLite files of ROS 2 bags (.db3), by rosbags."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from kernels.errors import InputError
from tools.readers.bags.recording import Message, Recording, refused, topics_of
from tools.readers.bags.unpack import ZSTD_START, unpacked

if TYPE_CHECKING:
    from rosbags.rosbag2 import Reader


def open_sqlite(path: Path) -> Recording:
    """The recording of a .db3 file, whose messages may be compressed one by one.

    Raises:
        InputError: it is no database of ROS 2 messages, or damaged.
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
                    if entry is None:
                        return
                    connection, time, content = entry
                    if not isinstance(content, bytes) or not isinstance(time, int):
                        raise InputError(f"a message of {connection.topic} is no bytes, or has no time; copy it again")
                    plain = unpacked(content, "zstd") if content.startswith(ZSTD_START) else content
            except InputError as error:
                faults.append(f"{error}; what follows is missing")
                return
            yield Message(connection.topic, connection.msgtype, time, plain, "cdr")


@contextmanager
def _opened(path: Path) -> Iterator[Reader]:
    from rosbags.rosbag2 import Reader

    with refused("it cannot be opened as the database of a ROS 2 bag"):
        reader = Reader(path)
        reader.open()
        counts = [connection.msgcount for connection in reader.connections]
        names = [text for connection in reader.connections for text in (connection.topic, connection.msgtype)]
        if not all(isinstance(text, str) for text in names) or not all(isinstance(count, int) for count in counts):
            reader.close()
            raise InputError("its table of topics is damaged; copy it again")
    try:
        yield reader
    finally:
        reader.close()
