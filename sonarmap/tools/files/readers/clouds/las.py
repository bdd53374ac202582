"""LAS and LAZ, versions 1.1 to 1.4, by laspy and lazrs: one file is one scan.

The chunks of LAZ are checked before they are unpacked, as lazrs takes memory for what they claim.
Format: https://www.asprs.org/divisions-committees/lidar-division/laser-las-file-format-exchange-activities, and of LAZ
https://downloads.rapidlasso.de/doc/LAZ_Specification_1.4_R1.pdf
"""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.clouds.apart import read_apart
from sonarmap.tools.files.readers.clouds.cloud import (
    COORDINATE_LIMIT,
    POINT_BYTES,
    VIEWPOINT_NAMES,
    Cloud,
    cloud_of_columns,
)
from sonarmap.tools.files.readers.clouds.rows import require_believable, require_bytes, surplus_note
from sonarmap.tools.files.time_scales import utc_of_gps

if TYPE_CHECKING:
    from laspy import LasHeader, LasReader
    from pyproj import CRS


_PIECE = 1 << 19  # points that are unpacked at a time
_LEAST_HEADER, _RECORD_HEADER = 227, 54  # bytes of a header, and of a variable length record's
_POINT_FORMAT, _COMPRESSED = 104, 0xC0  # a byte of the header, and its bits that say whether points are compressed
_ADJUSTED = 1_000_000_000  # seconds by which adjusted standard GPS time is less
_ONE_CHUNK, _LAYERED = 1, 3  # compressors: without chunks, and of point formats 6 to 10
_VARIABLE = 2**32 - 1  # points of a chunk, where the chunk table says how many each has
_AT_THE_END = -1  # the chunk table's place is in the file's last bytes
# Layers of an item by its type (POINT14, RGB14, RGBNIR14, WAVEPACKET14); BYTE14 has one for each of its bytes.
_LAYERS, _BYTE14 = {10: 9, 11: 1, 12: 2, 13: 1}, 14
_DAMAGED = "the file is cut or damaged; copy it again"


def read_las(content: bytes) -> list[Cloud]:
    """The points of a LAS or LAZ file, their intensity as strength, and their GPS times as they are; compressed points
    by another process, as damage can crash lazrs. The stamp is the first time in UTC, where the header says that times
    are adjusted standard GPS time. Raises InputError: a damaged or cut file, or map coordinates."""
    (cloud,) = read_map_las(content)
    _refuse_map_coordinates(cloud.points, content)
    return [cloud]


def read_map_las(content: bytes) -> list[Cloud]:
    """The same, also of map coordinates."""
    _require_sound_header(content)
    return read_apart(_read, content) if content[_POINT_FORMAT] & _COMPRESSED else _read(content)


def _read(content: bytes) -> list[Cloud]:
    import laspy

    try:
        with laspy.LasReader(io.BytesIO(content), laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as reader:
            _require_sound_points(content, reader.header)
            columns = _columns(reader)
            header = reader.header
    except (InputError, MemoryError):
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":  # lazrs's last resort
            raise
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"it cannot be read ({reason[:200]}): {_DAMAGED}") from error
    times = columns.get("gps_time")
    roles = {"strength": columns["intensity"], **({} if times is None else {"time": times})}
    cloud = cloud_of_columns(columns | roles, _surplus(content, header))
    return [replace(cloud, stamp=_stamp_of(times, header))]


def _require_sound_header(content: bytes) -> None:
    """Refuse what the library would look for without end."""
    if len(content) < _LEAST_HEADER:
        raise InputError(f"it has {len(content)} bytes, less than a LAS header: the file is cut; copy it again")
    points_start, records = (int.from_bytes(content[place : place + 4], "little") for place in (96, 100))
    require_bytes("a header", points_start, len(content))
    require_bytes(f"{records:,} variable length records", records * _RECORD_HEADER, points_start)


def _require_sound_points(content: bytes, header: LasHeader) -> None:
    """Refuse more points than the file, or this machine's memory, can hold."""
    count, size, start = header.point_count, header.point_format.size, header.offset_to_point_data
    require_believable(f"a cloud of {count:,} points", len(content), count * POINT_BYTES)
    if header.are_points_compressed:
        require_sound_chunks(content, header)
    else:
        require_bytes(f"{count:,} points of {size} bytes", count * size, len(content) - start)
    require_memory(f"a cloud of {count:,} points", count * (2 * size + 8 * 8), "thin its points out first")


def _surplus(content: bytes, header: LasHeader) -> list[str]:
    """A note about bytes that belong to no point, where nothing else may follow the points."""
    if header.are_points_compressed or header.number_of_evlrs or header.start_of_waveform_data_packet_record:
        return []
    end = header.offset_to_point_data + header.point_count * header.point_format.size
    return surplus_note(len(content) - end, "bytes", "point")


def _columns(reader: LasReader) -> dict[str, np.ndarray]:
    """x, y, z, intensity and, where the file has them, gps_time and vp_x, vp_y, vp_z, (N,) each."""
    names = ["x", "y", "z", "intensity"]
    present = set(reader.header.point_format.dimension_names)
    names += [name for group in (("gps_time",), VIEWPOINT_NAMES) if present.issuperset(group) for name in group]
    pieces: dict[str, list[np.ndarray]] = {name: [np.empty(0, "u2" if name == "intensity" else "f8")] for name in names}
    for points in reader.chunk_iterator(_PIECE):
        for name in names:
            pieces[name].append(np.array(points[name]))
    columns = {name: np.concatenate(arrays) for name, arrays in pieces.items()}
    if len(columns["x"]) != reader.header.point_count:
        raise InputError(
            f"the header promises {reader.header.point_count:,} points, and {len(columns['x']):,} follow: {_DAMAGED}"
        )
    return columns


def _stamp_of(times: np.ndarray | None, header: LasHeader) -> float | None:
    """Seconds since 1970; None where times are those of a GPS week, or there are none."""
    from laspy.header import GpsTimeType

    if times is None or header.global_encoding.gps_time_type != GpsTimeType.STANDARD:
        return None
    known = times[np.isfinite(times) & (np.abs(times) < _ADJUSTED * 10)]
    return float(utc_of_gps(known.min() + _ADJUSTED)) if known.any() else None


def _refuse_map_coordinates(points: np.ndarray, content: bytes) -> None:
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite) or np.abs(finite).max() <= COORDINATE_LIMIT:
        return
    ranges = ", ".join(
        f"{axis} {low:.10g} to {high:.10g}" for axis, low, high in zip("xyz", finite.min(0), finite.max(0), strict=True)
    )
    raise InputError(
        f"its points are map coordinates in {_crs_name(content)}: {ranges} m. Scans are wanted in meters in the "
        "sensor's own frame. If each file is what the sensor saw from one place, subtract the sensor's place from its "
        "points, as with `pdal translate` and filters.transformation; the tiles of a finished map are not scans"
    )


def _crs_name(content: bytes) -> str:
    crs = crs_of(content)
    return "an unnamed system" if crs is None else str(crs.name)[:100]


def crs_of(content: bytes) -> CRS | None:
    """The coordinate reference system of a file that could be read; None where it names none that is known."""
    from laspy import LasHeader

    with suppress(Exception):  # pyproj and laspy answer damage with errors of any kind
        return LasHeader.read_from(io.BytesIO(content)).parse_crs()
    return None


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
    """How many points chunks of so many bytes, from byte `start` on, hold: each is its first point as it is, their
    number, the layers' sizes, and the layers. `layout`: type and bytes of each item of a point. Raises InputError:
    layers that claim more than their chunk has."""
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
