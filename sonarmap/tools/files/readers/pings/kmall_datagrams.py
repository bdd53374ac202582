"""Datagrams of Kongsberg's .kmall files.

Format: Kongsberg 410224, "EM datagrams on *.kmall format". A datagram is its size, its type as #MRZ, its version,
system and echo sounder, a time, its content, and its size again; it has no checksum. Numbers are little endian.
Structures give their own sizes, as later versions are longer. A datagram may be split in parts that repeat its header.
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.pings.datagrams import Datagram, layout_of

_HEADER = struct.Struct("<I4sBBHII")  # size, type, version, system, echo sounder, time [s] and its rest [ns]
_SIZE = struct.Struct("<I")  # after the content
_TYPE = re.compile(rb"#[A-Z]{3}")
_PART = layout_of("count:u2 number:u2")  # of a split datagram, the first 1

# {stamp, number of parts: [{number of the part: its content}]}
Parts = dict[tuple[float, int], list[dict[int, bytes]]]


def datagrams_in(content: bytes) -> Iterator[Datagram | int]:
    """Datagrams; for bytes that are no datagram, their number."""
    start = 0
    while start < len(content):
        if size := _size_at(content, start):
            _, kind, _, system, model, seconds, nanoseconds = _HEADER.unpack_from(content, start)
            inner = content[start + _HEADER.size : start + size - _SIZE.size]
            yield Datagram(kind.decode("ascii"), model, seconds + nanoseconds * 1e-9, system, "<", inner)
            start += size
        else:
            places = (match.start() - _SIZE.size for match in _TYPE.finditer(content, start + 1 + _SIZE.size))
            following = next((place for place in places if _size_at(content, place)), len(content))
            yield following - start
            start = following


def _size_at(content: bytes, start: int) -> int:
    """Size of the datagram at `start`; 0 if there is none."""
    if start + _HEADER.size > len(content) or not _TYPE.match(content, start + _SIZE.size):
        return 0
    size = _SIZE.unpack_from(content, start)[0]
    end = start + size
    fits = _HEADER.size + _SIZE.size <= size and end <= len(content)
    return size if fits and _SIZE.unpack_from(content, end - _SIZE.size)[0] == size else 0


def joined(datagram: Datagram, parts: Parts) -> Datagram | None:
    """The datagram without the numbers of its part; None before its last part. `parts` wait for others: as fans of one
    ping have the same time, those of several."""
    count, number = (int(value) for value in datagram.rows(_PART)[0])
    if not 1 <= number <= count:
        raise InputError(f"is part {number} of {count}")
    content = datagram.content[_PART.itemsize :]
    if count > 1:
        waiting = parts[datagram.stamp, count]
        ping = next((ping for ping in waiting if number not in ping), None)
        if ping is None:
            waiting.append(ping := {})
        ping[number] = content
        if len(ping) < count:
            return None
        waiting.remove(ping)
        content = b"".join(part for _, part in sorted(ping.items()))
    return replace(datagram, content=content)


def strided(words: str, size: int) -> np.dtype:
    """The layout of fields "name:type", in structures of `size` bytes, of which later versions have more."""
    layout = layout_of(words)
    if size < layout.itemsize:
        raise InputError(f"has structures of {size} bytes; wanted at least {layout.itemsize}")
    return layout if size == layout.itemsize else layout_of(f"{words} rest:V{size - layout.itemsize}")
