"""Opening recordings of every format: MCAP, ROS 1 bags and SQLite (by rosbags), and ROS 2 bags that are folders.

MCAP files are read by their index, which lists the chunks of each topic. A file that was cut or has no index is read
sequentially as far as possible, and a growing file until it stops growing (https://mcap.dev/spec). A ROS 2 bag folder
has a sequence of files.
"""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from io import SEEK_END
from itertools import chain, repeat
from math import inf
from operator import attrgetter
from pathlib import Path, PurePath
from struct import Struct
from types import SimpleNamespace
from typing import IO, TYPE_CHECKING, Any, BinaryIO, cast
from zlib import crc32

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags.recording import (
    CUT_OR_DAMAGED,
    LARGEST,
    NOT_BELIEVABLE,
    ZSTD_START,
    HeldBytes,
    Message,
    Recording,
    Room,
    Unpacker,
    most_records,
    refused,
    topics_of,
)
from sonarmap.tools.files.readers.clouds.rows import most_unpacked
from sonarmap.tools.files.readers.selection import is_bag_folder
from sonarmap.tools.files.user_file import naming

if TYPE_CHECKING:
    from mcap.records import Channel, Chunk, McapRecord, Schema

_COMPRESSED = (".zstd", ".zst")
_IN_FOLDERS = (".db3", ".mcap")
_MAGIC = 8  # bytes of the magic number at a file's start
_RECORD = 512  # memory of a record beside its content [bytes]
_READS = 8  # largest number of reads per record
_END = Struct("<Q8xI8x")  # end of an MCAP file: offset of the summary, and its checksum
_UNCHECKED = 12  # bytes at the end that the checksum does not cover
_LARGEST_GROWN = 1 << 40  # assumed size of a growing file [bytes]
_Opened = Callable[[Path], AbstractContextManager[Any]]  # opens a file with the reader of rosbags
_Unpacked = Callable[[Any, Any, str], bytes]  # from content, time and topic to plain bytes; InputError if damaged


def is_recording(path: Path) -> bool:
    """Whether a path is a recording: a file by its suffix, or a folder that is a ROS 2 bag."""
    return path.suffix.lower() in (".bag", *_IN_FOLDERS) or is_bag_folder(path)


def open_recording(path: Path) -> Recording:
    """Open a file or folder for which `is_recording` is true."""
    return _open_folder(path) if path.is_dir() else _open_file(path, path.stat().st_size)


def _open_file(path: Path, packed: int) -> Recording:
    """Open one file. `packed`: its size before it was unpacked, if it was [bytes]."""
    match path.suffix.lower():
        case ".bag":
            return _recording(path, _opened_ros1, "ros1", lambda content, time, topic: content)
        case ".db3":
            return _open_sqlite(path, packed)
        case _:
            return open_mcap(path, packed)


def _open_folder(folder: Path) -> Recording:
    """Open all files of a bag in chronological order; of one that is there compressed and unpacked only the latter."""
    files = sorted(filter(_is_recording, folder.iterdir()), key=lambda file: (file.suffix not in _COMPRESSED, file))
    chosen = {_plain_name(file): file for file in files}.values()
    if not chosen:
        raise InputError(f"it has no file {' or '.join(_IN_FOLDERS)}; copy the whole folder")
    packed = [file.stat().st_size for file in chosen if file.suffix in _COMPRESSED]
    room = Room(sum(packed)) if packed else None
    parts = list[Recording]()
    for file in chosen:
        with naming(file.name):
            plain = room.unpack(file) if room and file.suffix in _COMPRESSED else file
            parts.append(_open_file(plain, file.stat().st_size))
    parts.sort(key=_start)
    counts = Counter[tuple[str, str]]()
    for topic in chain.from_iterable(part.topics for part in parts):
        counts[topic.name, topic.kind] += topic.count
    return Recording(topics_of(counts), partial(_messages_of_parts, parts, room))


def _messages_of_parts(
    parts: Sequence[Recording], _: Room | None, names: Collection[str], faults: list[str]
) -> Iterator[Message]:
    """The messages of all files. The unused argument keeps the unpacked files on disk while they may be read."""
    for part in parts:
        yield from part.messages(names, faults)


def _start(part: Recording) -> float:
    """Time of the first message [ns since 1970]; infinity if it cannot be read, so that the file comes last."""
    try:
        return next((message.time for message in part.messages([topic.name for topic in part.topics], [])), inf)
    except InputError:
        return inf


def _is_recording(file: Path) -> bool:
    return PurePath(_plain_name(file)).suffix in _IN_FOLDERS


def _plain_name(file: Path) -> str:
    return file.stem if file.suffix in _COMPRESSED else file.name


def open_mcap(path: Path, packed: int, more: Callable[[], bool] | None = None) -> Recording:
    """Open an MCAP file. `packed`: its size before it was unpacked, if it was [bytes]. `more`: for a growing file;
    called at its end, it waits and returns whether messages may still come. Topics are those present at opening."""
    faults: list[str] = []
    most = most_records(packed)
    contents = _indexed(path) or _counted(_records(path, most, faults))
    empty: dict[int, Message] = {}  # a message of each channel, without time and content
    known = Counter[tuple[str, str]]()
    for number, channel in contents.channels.items():
        schema, encoding = contents.schemas.get(channel.schema_id), channel.message_encoding
        kind = schema.name if schema else "(no type)"
        if kind.count("/") == 1:  # ROS 1 leaves the /msg/ out
            kind = kind.replace("/", "/msg/")
        needed = schema.data if schema and encoding == "protobuf" else b""
        empty[number] = Message(channel.topic, kind, 0, b"", encoding, needed)
        known[channel.topic, kind] += contents.counts.get(number, 0)
    if not known.total():
        raise InputError(faults[0] if faults else "there is no message in it; record its topics again")
    if more is not None:
        return Recording(topics_of(known), partial(_messages, path, most_records(_LARGEST_GROWN), empty, None, more))
    return Recording(topics_of(known), partial(_messages, path, most, empty, contents.chunks, None))


@dataclass(frozen=True, slots=True)
class _Contents:
    """The table of contents of an MCAP file."""

    schemas: Mapping[int, Schema]  # by id
    channels: Mapping[int, Channel]  # by id
    counts: Mapping[int, int]  # number of messages of each channel
    # (offset, channels) of the chunks in the file's order, where no channels stand for any; None if unknown
    chunks: Sequence[tuple[int, Collection[int]]] | None


def _indexed(path: Path) -> _Contents | None:
    """The contents by the summary at the file's end; None if it is missing, damaged or incomplete."""
    from mcap.opcode import Opcode
    from mcap.reader import SeekingReader

    size = path.stat().st_size
    try:
        with HeldBytes(path) as file, refused("its summary cannot be read"):
            # the reader would read any records before a header, even chunks that unpack to gigabytes
            if file.read(_MAGIC + 1)[_MAGIC:] != bytes([Opcode.HEADER]):
                return None
            file.seek(0)
            reader = SeekingReader(file, record_size_limit=size)
            reader.get_header()
            summary = reader.get_summary()
            file.seek(-_END.size, SEEK_END)
            start, checksum = _END.unpack(file.read())
            file.seek(start)
            if checksum not in (0, crc32(file.read(size - start - _UNCHECKED))):
                return None
    except InputError:
        return None
    if summary is None or (statistics := summary.statistics) is None:
        return None
    counts = statistics.channel_message_counts
    chunks = sorted(summary.chunk_indexes, key=attrgetter("chunk_start_offset"))
    if not (counts.keys() <= summary.channels.keys() and 0 < len(chunks) == statistics.chunk_count):
        return None
    starts = [(chunk.chunk_start_offset, chunk.message_index_offsets.keys()) for chunk in chunks]
    return _Contents(summary.schemas, summary.channels, counts, starts)


def _counted(records: Iterator[McapRecord]) -> _Contents:
    """The contents by a pass over all records."""
    from mcap.records import Channel, Schema
    from mcap.records import Message as Record

    schemas, channels, counts = dict[int, Schema](), dict[int, Channel](), Counter[int]()
    for record in records:
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Record):
            counts[record.channel_id] += 1
    return _Contents(schemas, channels, counts, None)


def _messages(
    path: Path,
    most: int,
    empty: Mapping[int, Message],
    chunks: Sequence[tuple[int, Collection[int]]] | None,
    more: Callable[[], bool] | None,
    names: Collection[str],
    faults: list[str],
) -> Iterator[Message]:
    """Yield the messages of some topics in the order of the file, and within a chunk by time."""
    from mcap.records import Message as Record

    wanted = {number for number, of in empty.items() if of.topic in names}
    starts = None
    if chunks is not None:
        starts = [start for start, channels in chunks if not channels or not wanted.isdisjoint(channels)]
    for record in _records(path, most, faults, more, starts):
        if isinstance(record, Record) and record.channel_id in wanted:
            yield replace(empty[record.channel_id], time=record.log_time, content=record.data)


def _records(
    path: Path,
    most: int,
    faults: list[str],
    more: Callable[[], bool] | None = None,
    starts: Sequence[int] | None = None,
) -> Iterator[McapRecord]:
    """Yield every record, including those in chunks, or only those of the chunks at the offsets `starts`. A damaged
    chunk is skipped; a record that is cut ends the sequence. `most`: largest plausible number of records."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    size = path.stat().st_size if more is None else _LARGEST_GROWN
    with path.open("rb") as file:
        whole, chunks = _WholeReads(file, path, _READS * most, more), _Chunks(Unpacker(size), most)
        stream = partial(StreamReader, cast(IO[bytes], whole), emit_chunks=True, record_size_limit=None)
        records = iter(stream(skip_magic=False).records)
        for place in repeat(None) if starts is None else starts:
            if place is not None:
                whole.seek(place)
                records = iter(stream(skip_magic=True).records)
            start = whole.place
            try:
                with refused(f"its record at byte {start:,} cannot be read"):
                    record = next(records, None)
            except InputError as error:
                faults.append(str(error))
                if place is None:
                    return
                continue
            if record is None:
                return
            try:
                with refused(f"its chunk at byte {start:,} cannot be unpacked"):
                    if place is not None and not isinstance(record, Chunk):
                        raise InputError(f"its index names a chunk at byte {start:,}, and there is none")
                    inner = chunks.records(record) if isinstance(record, Chunk) else [record]
            except InputError as error:
                faults.append(f"{error}: the messages in it are missing")
                continue
            yield from inner


@dataclass(slots=True)
class _Chunks:
    """Splits the chunks of a file into records, with limits for each chunk and for all of them."""

    unpacked: Unpacker  # unpacks a chunk's bytes
    left: int  # number of records that may still come

    def records(self, chunk: Chunk) -> list[McapRecord]:
        """The records of a chunk: schemas and channels, then messages by time."""
        from mcap.records import Message as Record
        from mcap.stream_reader import breakup_chunk

        plain = self.unpacked(chunk.data, chunk.compression)
        if len(plain) != chunk.uncompressed_size:
            raise InputError(f"it claims {chunk.uncompressed_size:,} bytes and holds {len(plain):,}")
        self.left -= _count_records(plain, min(self.left, most_unpacked(len(chunk.data)) // _RECORD))
        records = breakup_chunk(replace(chunk, data=plain, compression=""), validate_crc=True)
        return sorted(records, key=lambda record: record.log_time if isinstance(record, Record) else -1)


def _count_records(plain: bytes, most: int) -> int:
    """Number of records in a chunk: each is one byte for its kind, eight for its length, and its content."""
    place = count = 0
    while place < len(plain):
        place += 9 + int.from_bytes(plain[place + 1 : place + 9], "little")
        count += 1
        if count > most:
            raise InputError(f"it holds more than the {most:,} records that may still come, {NOT_BELIEVABLE}")
    return count


class _WholeReads:
    """A file whose reads return all bytes or raise InputError. `most`: largest plausible number of reads; `more`: see
    `open_mcap`."""

    def __init__(self, file: BinaryIO, path: Path, most: int, more: Callable[[], bool] | None = None) -> None:
        self._file, self._path, self._reads_left, self._more = file, path, most, more
        self._size = path.stat().st_size
        self.place = 0

    def seek(self, place: int) -> None:
        """Continue at an offset [bytes]."""
        self.place = self._file.seek(place)

    def read(self, length: int) -> bytes:
        """Read the next `length` bytes."""
        self._reads_left -= 1
        if self._reads_left < 0:
            raise InputError(f"it has too many records before byte {self.place:,}, {NOT_BELIEVABLE}")
        while self._more is not None and self._size - self.place < length <= LARGEST and self._more():
            self._size = self._path.stat().st_size
        remaining = self._size - self.place
        if not 0 <= length <= min(remaining, LARGEST):
            raise InputError(f"at byte {self.place:,} it claims {length:,} of {remaining:,} bytes: {CUT_OR_DAMAGED}")
        content = self._file.read(length)
        self.place += len(content)
        return content


def _open_sqlite(path: Path, size: int) -> Recording:
    """Open the SQLite database of a ROS 2 bag, whose messages may be compressed one by one."""
    recording = _recording(path, _opened_sqlite, "cdr", partial(_plain, Unpacker(size)))
    if sum(topic.count for topic in recording.topics) > most_records(size):
        raise InputError(f"it has more than {most_records(size):,} messages, {NOT_BELIEVABLE}")
    return recording


def _recording(path: Path, opened: _Opened, encoding: str, unpacked: _Unpacked) -> Recording:
    counts: Counter[tuple[str, str]] = Counter()
    with opened(path) as reader:
        for connection in reader.connections:
            counts[connection.topic, connection.msgtype] += connection.msgcount
    return Recording(topics_of(counts), partial(_indexed_messages, path, opened, encoding, unpacked))


def _indexed_messages(
    path: Path, opened: _Opened, encoding: str, unpacked: _Unpacked, names: Collection[str], faults: list[str]
) -> Iterator[Message]:
    with opened(path) as reader:
        wanted = [connection for connection in reader.connections if connection.topic in names]
        try:
            with refused("one of its messages cannot be read"):
                for connection, time, content in reader.messages(wanted) if wanted else ():
                    plain = unpacked(content, time, connection.topic)
                    yield Message(connection.topic, connection.msgtype, time, plain, encoding)
        except InputError as error:
            faults.append(f"{error}; the messages after it are missing")


@contextmanager
def _opened_ros1(path: Path) -> Iterator[Any]:
    """Open a ROS 1 bag by its index, with a limit on the unpacked size of chunks."""
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
    """Raise InputError for generated columns: a few bytes of schema could make SQLite compute gigabytes per message."""
    with closing(sqlite3.connect(path)) as database:
        computed = "SELECT t.name FROM sqlite_master t, pragma_table_xinfo(t.name) c WHERE c.hidden LIMIT 1"
        if table := database.execute(computed).fetchone():
            raise InputError(f"its table {table[0]} has a generated column, which no recorder writes: copy it again")


def _plain(unpacked: Unpacker, content: Any, time: Any, topic: str) -> bytes:
    if not isinstance(content, bytes) or not isinstance(time, int):
        raise InputError(f"a message of {topic} is not bytes, or has no time; copy it again")
    return unpacked(content, "zstd") if content.startswith(ZSTD_START) else content
