"""The SQLite files of ROS 2 bags (.db3), by rosbags."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags.indexed import indexed_recording
from sonarmap.tools.files.readers.bags.recording import Recording, refused
from sonarmap.tools.files.readers.bags.unpack import NOT_BELIEVABLE, ZSTD_START, Unpacker, most_records

if TYPE_CHECKING:
    from rosbags.rosbag2 import Reader


def open_sqlite(path: Path, packed: int | None = None) -> Recording:
    """The recording of a .db3 file, whose messages may be compressed one by one.

    Args:
        path: of the file.
        packed: its bytes before it was unpacked, if it was.

    Raises:
        InputError: it is no database of ROS 2 messages, or damaged, or has too many messages for its bytes.
    """
    size = path.stat().st_size if packed is None else packed
    recording = indexed_recording(path, _opened, "cdr", partial(_plain, Unpacker(size)))
    if sum(topic.count for topic in recording.topics) > most_records(size):
        raise InputError(f"it has more than {most_records(size):,} messages, {NOT_BELIEVABLE}")
    return recording


def _plain(unpacked: Unpacker, content: Any, time: Any, topic: str) -> bytes:
    if not isinstance(content, bytes) or not isinstance(time, int):
        raise InputError(f"a message of {topic} is not bytes, or has no time; copy it again")
    return unpacked(content, "zstd") if content.startswith(ZSTD_START) else content


def _require_stored(path: Path) -> None:
    """Refuse columns that SQLite computes: a few bytes of schema would make a gigabyte of each message."""
    with closing(sqlite3.connect(path)) as database:
        computed = "SELECT t.name FROM sqlite_master t, pragma_table_xinfo(t.name) c WHERE c.hidden LIMIT 1"
        if table := database.execute(computed).fetchone():
            raise InputError(f"its table {table[0]} has a column that is computed, as no recorder does: copy it again")


@contextmanager
def _opened(path: Path) -> Iterator[Reader]:
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
    try:
        yield reader
    finally:
        reader.close()
