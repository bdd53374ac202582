"""Recordings that a reader of rosbags opens: topics by its index, messages one by one."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags.recording import Message, Recording, refused, topics_of

Opened = Callable[[Path], AbstractContextManager[Any]]
Unpacked = Callable[[Any, Any, str], bytes]  # of a message's content, time and topic; InputError where they are damaged


def indexed_recording(path: Path, opened: Opened, encoding: str, unpacked: Unpacked) -> Recording:
    """The recording of a file.

    Args:
        opened: gives its reader, of `rosbags.rosbag1` or `rosbags.rosbag2`.
        encoding: of its messages, as `Message` has it.
        unpacked: the bytes of a message.

    Raises InputError: the file cannot be opened.
    """
    counts: Counter[tuple[str, str]] = Counter()
    with opened(path) as reader:
        for connection in reader.connections:
            counts[connection.topic, connection.msgtype] += connection.msgcount
    return Recording(topics_of(counts), partial(_messages, path, opened, encoding, unpacked))


def _messages(
    path: Path, opened: Opened, encoding: str, unpacked: Unpacked, names: Collection[str], faults: list[str]
) -> Iterator[Message]:
    with opened(path) as reader:
        wanted = [connection for connection in reader.connections if connection.topic in names]
        messages: Iterator[Any] = reader.messages(wanted) if wanted else iter(())
        while True:
            try:
                with refused("a message of it cannot be read"):
                    entry = next(messages, None)
                    if entry is None:
                        return
                    connection, time, content = entry
                    plain = unpacked(content, time, connection.topic)
            except InputError as error:
                faults.append(f"{error}; what follows is missing")
                return
            yield Message(connection.topic, connection.msgtype, time, plain, encoding)
