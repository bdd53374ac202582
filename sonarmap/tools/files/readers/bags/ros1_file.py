"""ROS 1 bags, format 2.0, by rosbags: through their index, chunk by chunk."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.tools.files.readers.bags.indexed import indexed_recording
from sonarmap.tools.files.readers.bags.recording import Recording, refused
from sonarmap.tools.files.readers.bags.unpack import Unpacker

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader


def open_ros1(path: Path) -> Recording:
    """The recording of a ROS 1 bag. Raises InputError: its index is missing or damaged."""
    return indexed_recording(path, _opened, "ros1", lambda content, time, topic: content)


@contextmanager
def _opened(path: Path) -> Iterator[Reader]:
    """The bag with its index, and chunks that unpack to a limit."""
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import decompressors

    names = {decompressor: name for name, decompressor in decompressors.items()}
    reader, unpacked = Reader(path), Unpacker(path.stat().st_size)
    with refused("its index cannot be read; `rosbag reindex` makes another"):
        reader.open()
        for place, chunk in reader.chunks.items():
            limited = partial(unpacked, compression=names[chunk.decompressor])
            reader.chunks[place] = chunk._replace(decompressor=limited)
    try:
        yield reader
    finally:
        reader.close()
