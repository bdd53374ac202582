"""The chunks of a LAZ file, checked before they are unpacked: lazrs takes memory for what they claim."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.rows import require_bytes

if TYPE_CHECKING:
    from laspy import LasHeader

_ONE_CHUNK, _LAYERED = 1, 3  # compressors: without chunks, and of point formats 6 to 10
_VARIABLE = 2**32 - 1  # points of a chunk, where the chunk table says how many each has
_AT_THE_END = -1  # the chunk table's place is in the file's last bytes
# Layers of an item by its type (POINT14, RGB14, RGBNIR14, WAVEPACKET14); BYTE14 has one for each of its bytes.
_LAYERS, _BYTE14 = {10: 9, 11: 1, 12: 2, 13: 1}, 14
_DAMAGED = "the file is cut or damaged; copy it again"


def require_sound_chunks(content: bytes, header: LasHeader) -> None:
    """Refuse chunks and layers that claim more bytes than they have, or another number of points. Raises InputError:
    the file is cut or damaged."""
    lazrs: Any = import_module("lazrs")  # it has no stubs
    (vlr,) = header.vlrs.get("LasZipVlr") or (None,)
    if vlr is None:
        raise InputError(f"it is compressed, and has no record that says how: {_DAMAGED}")
    record = bytes(vlr.record_data_bytes())
    require_bytes("a LASzip record", 34, len(record))
    compressor, chunk_size, items = struct.unpack_from("<H10xI16xH", record)
    require_bytes(f"{items} LASzip items", 34 + 6 * items, len(record))
    layout = [struct.unpack_from("<HH", record, 34 + 6 * item) for item in range(items)]
    if sum(size for _, size in layout) != header.point_format.size or chunk_size == 0:
        raise InputError(f"its LASzip record says {chunk_size} points per chunk, of another size: {_DAMAGED}")
    if compressor == _ONE_CHUNK:
        return
    start = header.offset_to_point_data + 8
    table = _chunk_table_place(content, start, header.point_count)
    stream = io.BytesIO(content)
    stream.seek(start - 8)
    chunks = [held for _, held in lazrs.read_chunk_table(stream, lazrs.LazVlr(record)) or []]
    if sum(chunks) != table - start:
        raise InputError(f"its chunks claim {sum(chunks):,} bytes, and there are {table - start:,}: {_DAMAGED}")
    if chunk_size != _VARIABLE and len(chunks) != -(-header.point_count // chunk_size):
        raise InputError(f"its {header.point_count:,} points do not fill {len(chunks):,} chunks: {_DAMAGED}")
    if compressor == _LAYERED:
        points = _points_of_layers(content, start, chunks, layout)
        if points != header.point_count:
            raise InputError(f"its chunks hold {points:,} points, its header says {header.point_count:,}: {_DAMAGED}")


def _chunk_table_place(content: bytes, start: int, points: int) -> int:
    """Where the chunk table begins."""
    require_bytes("the place of a chunk table", start, len(content))
    (place,) = struct.unpack_from("<q", content, start - 8)
    if place == _AT_THE_END:
        (place,) = struct.unpack_from("<q", content, len(content) - 8)
    if not start <= place <= len(content) - 8:
        raise InputError(f"its chunk table is said to be at byte {place:,}: {_DAMAGED}")
    _, chunks = struct.unpack_from("<II", content, place)
    if chunks > min(points, len(content)):
        raise InputError(f"it claims {chunks:,} chunks of {points:,} points: {_DAMAGED}")
    return place


def _points_of_layers(content: bytes, start: int, chunks: Sequence[int], layout: Sequence[tuple[int, int]]) -> int:
    """How many points chunks hold: each is its first point as it is, their number, the layers' sizes, and the layers.

    Args:
        start: the byte at which the first chunk begins.
        chunks: their bytes.
        layout: type and bytes of each item of a point.

    Raises InputError: layers that claim more than their chunk has.
    """
    points, plain = 0, sum(size for _, size in layout)
    layers = sum(size if kind == _BYTE14 else _LAYERS.get(kind, 0) for kind, size in layout)
    for number, held in enumerate(chunks):
        if held:
            claimed = plain + 4 + 4 * layers
            if claimed <= held:
                count, *sizes = struct.unpack_from(f"<{1 + layers}I", content, start + plain)
                points += count
                claimed += sum(sizes)
            if claimed > held:
                raise InputError(
                    f"the layers of chunk {number} claim {claimed:,} bytes, and it has {held:,}: {_DAMAGED}"
                )
        start += held
    return points
