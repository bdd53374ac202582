"""Recordings that rosbags opens: topics by its index, messages one by one, of ROS 1 bags and the SQLite of ROS 2."""

import sqlite3
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags.recording import Message, Recording, refused, topics_of
from sonarmap.tools.files.readers.bags.unpack import NOT_BELIEVABLE, ZSTD_START, HeldBytes, Unpacker, most_records

_Opened = Callable[[Path], AbstractContextManager[Any]]  # gives the reader of `rosbags` of a file
_Unpacked = Callable[[Any, Any, str], bytes]  # of a message's content, time and topic; InputError where it is damaged


def open_ros1(path: Path) -> Recording:
    """The recording of a ROS 1 bag, format 2.0. Raises InputError: its index is missing or damaged."""
    return _recording(path, _opened_ros1, "ros1", lambda content, time, topic: content)


def open_sqlite(path: Path, packed: int | None = None) -> Recording:
    """The recording of a .db3 file, whose messages may be compressed one by one. `packed`: its bytes before it was
    unpacked, if it was. Raises InputError: no database of ROS 2 messages, a damaged one, or too many for its bytes."""
    size = path.stat().st_size if packed is None else packed
    recording = _recording(path, _opened_sqlite, "cdr", partial(_plain, Unpacker(size)))
    if sum(topic.count for topic in recording.topics) > most_records(size):
        raise InputError(f"it has more than {most_records(size):,} messages, {NOT_BELIEVABLE}")
    return recording


def _recording(path: Path, opened: _Opened, encoding: str, unpacked: _Unpacked) -> Recording:
    counts: Counter[tuple[str, str]] = Counter()
    with opened(path) as reader:
        for connection in reader.connections:
            counts[connection.topic, connection.msgtype] += connection.msgcount
    return Recording(topics_of(counts), partial(_messages, path, opened, encoding, unpacked))


def _messages(
    path: Path, opened: _Opened, encoding: str, unpacked: _Unpacked, names: Collection[str], faults: list[str]
) -> Iterator[Message]:
    with opened(path) as reader:
        wanted = [connection for connection in reader.connections if connection.topic in names]
        try:
            with refused("a message of it cannot be read"):
                for connection, time, content in reader.messages(wanted) if wanted else ():
                    plain = unpacked(content, time, connection.topic)
                    yield Message(connection.topic, connection.msgtype, time, plain, encoding)
        except InputError as error:
            faults.append(f"{error}; what follows is missing")


@contextmanager
def _opened_ros1(path: Path) -> Iterator[Any]:
    """The bag with its index, and chunks that unpack to a limit."""
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import decompressors

    names = {decompressor: name for name, decompressor in decompressors.items()}
    reader, unpacked = Reader(path), Unpacker(path.stat().st_size)
    with refused("its index cannot be read; `rosbag reindex` makes another"):
        reader.path = cast(Any, SimpleNamespace(open=lambda _: HeldBytes(path)))
        reader.open()
        for place, chunk in reader.chunks.items():
            limited = partial(unpacked, compression=names[chunk.decompressor])
            reader.chunks[place] = chunk._replace(decompressor=limited)
    with closing(reader):
        yield reader


@contextmanager
def _opened_sqlite(path: Path) -> Iterator[Any]:
    from rosbags.rosbag2 import Reader

    with refused("it cannot be opened as the database of a ROS 2 bag"):
        _require_stored(path)
        reader = Reader(path)
        reader.open()
        counts = [connection.msgcount for connection in reader.connections]
        names = [text for connection in reader.connections for text in (connection.topic, connection.msgtype)]
        if not all(isinstance(text, str) for text in names) or not all(isinstance(count, int) for count in counts):
            reader.close()
            raise InputError("its table of topics is damaged; copy it again")
    with closing(reader):
        yield reader


def _require_stored(path: Path) -> None:
    """Refuse columns that SQLite computes: a few bytes of schema would make a gigabyte of each message."""
    with closing(sqlite3.connect(path)) as database:
        computed = "SELECT t.name FROM sqlite_master t, pragma_table_xinfo(t.name) c WHERE c.hidden LIMIT 1"
        if table := database.execute(computed).fetchone():
            raise InputError(f"its table {table[0]} has a column that is computed, as no recorder does: copy it again")


def _plain(unpacked: Unpacker, content: Any, time: Any, topic: str) -> bytes:
    if not isinstance(content, bytes) or not isinstance(time, int):
        raise InputError(f"a message of {topic} is not bytes, or has no time; copy it again")
    return unpacked(content, "zstd") if content.startswith(ZSTD_START) else content
