"""MCAP from its first byte to its last: a file that was cut, or has no index, is read as far as it goes, and one that
grows for as long as it does.

Format: https://mcap.dev/spec.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, BinaryIO, cast

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags.recording import CUT_OR_DAMAGED, Message, Recording, refused, topics_of
from sonarmap.tools.files.readers.bags.unpack import LARGEST, NOT_BELIEVABLE, Unpacker, most_records
from sonarmap.tools.files.readers.clouds.rows import most_unpacked

if TYPE_CHECKING:
    from mcap.records import Channel, Chunk, McapRecord, Schema

_RECORD = 512  # bytes of memory that a record takes beside its content
_READS = 8  # that a record takes at most
_LARGEST_GROWN = 1 << 40  # bytes of a file that grows


def open_mcap(path: Path, packed: int | None = None, more: Callable[[], bool] | None = None) -> Recording:
    """The recording of an MCAP file. `packed`: its bytes before it was unpacked, if it was. `more`: whether messages
    may still come, asked where the file ends, after waiting; None for a finished one. Its topics are those that are
    there. Raises InputError: there is no message in it."""
    from mcap.records import Channel, Schema
    from mcap.records import Message as Record

    faults: list[str] = []
    schemas: dict[int, Schema] = {}
    written: dict[int, Channel] = {}
    counts = Counter[int]()
    most = most_records(path.stat().st_size if packed is None else packed)
    for record in _records(path, most, faults):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            written[record.id] = record
        elif isinstance(record, Record):
            counts[record.channel_id] += 1
    empty: dict[int, Message] = {}  # of each channel, without time and content
    known = Counter[tuple[str, str]]()
    for number, channel in written.items():
        schema, encoding = schemas.get(channel.schema_id), channel.message_encoding
        kind = schema.name if schema else "(no type)"
        if kind.count("/") == 1:  # ROS 1 leaves the /msg/ out
            kind = kind.replace("/", "/msg/")
        needed = schema.data if schema and encoding == "protobuf" else b""
        empty[number] = Message(channel.topic, kind, 0, b"", encoding, needed)
        known[channel.topic, kind] += counts[number]
    if not known.total():
        raise InputError(faults[0] if faults else "there is no message in it; record its topics again")
    if more is not None:
        most = most_records(_LARGEST_GROWN)
    return Recording(topics_of(known), partial(_messages, path, most, empty, more))


def _messages(
    path: Path,
    most: int,
    empty: Mapping[int, Message],
    more: Callable[[], bool] | None,
    names: Collection[str],
    faults: list[str],
) -> Iterator[Message]:
    """In the order of the file, and by their times within a chunk."""
    from mcap.records import Message as Record

    for record in _records(path, most, faults, more):
        if isinstance(record, Record) and (of := empty.get(record.channel_id)) and of.topic in names:
            yield replace(of, time=record.log_time, content=record.data)


def _records(path: Path, most: int, faults: list[str], more: Callable[[], bool] | None = None) -> Iterator[McapRecord]:
    """Every record, those in chunks too, of which there may be `most` believably. A chunk that is damaged is left out;
    what is cut or has no end is the end."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    size = path.stat().st_size if more is None else _LARGEST_GROWN
    with path.open("rb") as file:
        whole, chunks = _WholeReads(file, path, _READS * most, more), _Chunks(Unpacker(size), most)
        records = iter(StreamReader(cast(IO[bytes], whole), emit_chunks=True, record_size_limit=None).records)
        while True:
            start = whole.place
            try:
                with refused(f"its record at byte {start:,} cannot be read"):
                    record = next(records, None)
            except InputError as error:
                faults.append(str(error))
                return
            if record is None:
                return
            try:
                with refused(f"its chunk at byte {start:,} cannot be unpacked"):
                    inner = chunks.records(record) if isinstance(record, Chunk) else [record]
            except InputError as error:
                faults.append(f"{error}: the messages in it are missing")
                continue
            yield from inner


@dataclass(slots=True)
class _Chunks:
    """Takes the chunks of a file apart, within bounds for each and for all of them."""

    unpacked: Unpacker  # their bytes
    left: int  # how many records may still come

    def records(self, chunk: Chunk) -> list[McapRecord]:
        """Schemas and channels first, then messages by their times."""
        from mcap.records import Message as Record
        from mcap.stream_reader import breakup_chunk

        plain = self.unpacked(chunk.data, chunk.compression)
        if len(plain) != chunk.uncompressed_size:
            raise InputError(f"it claims {chunk.uncompressed_size:,} bytes and holds {len(plain):,}")
        self.left -= _count_records(plain, min(self.left, most_unpacked(len(chunk.data)) // _RECORD))
        records = breakup_chunk(replace(chunk, data=plain, compression=""), validate_crc=True)
        return sorted(records, key=lambda record: record.log_time if isinstance(record, Record) else -1)


def _count_records(plain: bytes, most: int) -> int:
    """How many records a chunk has: each is a byte of its kind, eight of its length, and its content. Raises
    InputError: more than `most`."""
    place = count = 0
    while place < len(plain):
        place += 9 + int.from_bytes(plain[place + 1 : place + 9], "little")
        count += 1
        if count > most:
            raise InputError(f"it holds more than the {most:,} records that may still come, {NOT_BELIEVABLE}")
    return count


class _WholeReads:
    """A file whose every read is whole. `most`: how many reads it may take believably; `more` as of `open_mcap`."""

    def __init__(self, file: BinaryIO, path: Path, most: int, more: Callable[[], bool] | None = None) -> None:
        self._file, self._path, self._left, self._more = file, path, most, more
        self._size = path.stat().st_size
        self.place = 0

    def read(self, length: int) -> bytes:
        """The next bytes. Raises InputError: there are not so many, or more than memory should hold, or too many reads;
        nothing is read then."""
        self._left -= 1
        if self._left < 0:
            raise InputError(f"it has too many records before byte {self.place:,}, {NOT_BELIEVABLE}")
        while self._more is not None and self._size - self.place < length <= LARGEST and self._more():
            self._size = self._path.stat().st_size
        left = self._size - self.place
        if not 0 <= length <= min(left, LARGEST):
            raise InputError(
                f"at byte {self.place:,} it claims {length:,} bytes more, and {left:,} are left: {CUT_OR_DAMAGED}"
            )
        content = self._file.read(length)
        self.place += len(content)
        return content
