"""LAS and LAZ files, versions 1.1 to 1.4, read with laspy and lazrs: one file is one scan.

Format: https://www.asprs.org/divisions-committees/lidar-division/laser-las-file-format-exchange-activities
"""

from __future__ import annotations

import io
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.kernels.kept_child import run_apart
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.clouds.cloud import (
    DEGREES,
    POINT_BYTES,
    VIEWPOINT_NAMES,
    Cloud,
    cloud_of_columns,
    refuse_map_coordinates,
)
from sonarmap.tools.files.readers.clouds.rows import require_believable, require_bytes, surplus_note
from sonarmap.tools.files.time_scales import utc_of_gps
from sonarmap.tools.files.user_file import naming

if TYPE_CHECKING:
    from laspy import LasHeader, LasReader
    from pyproj import CRS

_PIECE = 1 << 19  # points that are unpacked at a time
_LEAST_HEADER, _RECORD_HEADER = 227, 54  # bytes of the shortest header, and of a variable length record's header
_POINT_FORMAT, _COMPRESSED = 104, 0xC0  # offset of the point format in the header, and its bits for compression
_ADJUSTED = 1_000_000_000  # GPS time minus adjusted standard GPS time [s]
_DAMAGED = "the file is cut or damaged; copy it again"


def read_las(content: bytes) -> list[Cloud]:
    """Read the points of a LAS or LAZ file, with intensity as strength, and GPS times not converted. The stamp is the
    first time in UTC if the header declares adjusted standard GPS time."""
    (cloud,) = read_map_las(content)
    finite = cloud.points[np.isfinite(cloud.points).all(axis=1)]
    if len(finite) and (crs := crs_of(content)) is not None:
        with naming(f"its points are in {str(crs.name)[:100]}"):
            if crs.is_geographic and (np.abs(finite[:, :2]) <= 180).all():
                raise InputError(DEGREES)
            refuse_map_coordinates(finite)
    return [cloud]


def read_map_las(content: bytes) -> list[Cloud]:
    """Like `read_las`, but allows map coordinates. Compressed points are read in another process, as damaged files can
    crash lazrs or make it allocate all memory."""
    _require_sound_header(content)
    return run_apart(_read, content) if content[_POINT_FORMAT] & _COMPRESSED else _read(content)


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
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":  # a panic in lazrs
            raise
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"it cannot be read ({reason[:200]}): {_DAMAGED}") from error
    times = columns.get("gps_time")
    roles = {"strength": columns["intensity"], **({} if times is None else {"time": times})}
    cloud = cloud_of_columns(columns | roles, _surplus(content, header))
    return [replace(cloud, stamp=_stamp_of(times, header))]


def _require_sound_header(content: bytes) -> None:
    """Raise InputError for a header that would keep laspy searching for records that are not there."""
    if len(content) < _LEAST_HEADER:
        raise InputError(f"it has {len(content)} bytes, less than a LAS header: the file is cut; copy it again")
    points_start, records = (int.from_bytes(content[place : place + 4], "little") for place in (96, 100))
    require_bytes("a header", points_start, len(content))
    require_bytes(f"{records:,} variable length records", records * _RECORD_HEADER, points_start)


def _require_sound_points(content: bytes, header: LasHeader) -> None:
    """Raise InputError if the header promises more points than the file or this machine's memory can hold."""
    count, size, start = header.point_count, header.point_format.size, header.offset_to_point_data
    require_believable(f"a cloud of {count:,} points", len(content), count * POINT_BYTES)
    if not header.are_points_compressed:
        require_bytes(f"{count:,} points of {size} bytes", count * size, len(content) - start)
    require_memory(f"a cloud of {count:,} points", count * (2 * size + 8 * 8), "thin its points out first")


def _surplus(content: bytes, header: LasHeader) -> list[str]:
    """A note about bytes after the last point, if no other records may follow the points."""
    if header.are_points_compressed or header.number_of_evlrs or header.start_of_waveform_data_packet_record:
        return []
    end = header.offset_to_point_data + header.point_count * header.point_format.size
    return surplus_note(len(content) - end, "bytes", "point")


def _columns(reader: LasReader) -> dict[str, np.ndarray]:
    """Columns (N,) x, y, z, intensity and, if the file has them, gps_time and vp_x, vp_y, vp_z."""
    names = ["x", "y", "z", "intensity"]
    present = set(reader.header.point_format.dimension_names)
    names += [name for group in (("gps_time",), VIEWPOINT_NAMES) if present.issuperset(group) for name in group]
    pieces: dict[str, list[np.ndarray]] = {name: [np.empty(0, "u2" if name == "intensity" else "f8")] for name in names}
    for points in reader.chunk_iterator(_PIECE):
        for name in names:
            pieces[name].append(np.array(points[name]))
    columns = {name: np.concatenate(arrays) for name, arrays in pieces.items()}
    if len(columns["x"]) != reader.header.point_count:
        raise InputError(f"{reader.header.point_count:,} points are promised, {len(columns['x']):,} follow: {_DAMAGED}")
    return columns


def _stamp_of(times: np.ndarray | None, header: LasHeader) -> float | None:
    """The first time [s, UTC]; None if there are no times, or only times of a GPS week."""
    from laspy.header import GpsTimeType

    if times is None or header.global_encoding.gps_time_type != GpsTimeType.STANDARD:
        return None
    known = times[np.isfinite(times) & (np.abs(times) < _ADJUSTED * 10)]
    return float(utc_of_gps(known.min() + _ADJUSTED)) if known.any() else None


def crs_of(content: bytes) -> CRS | None:
    """The coordinate reference system of a readable file; None if it has none that pyproj knows."""
    from laspy import LasHeader

    with suppress(Exception):  # pyproj and laspy answer damage with errors of any kind
        return LasHeader.read_from(io.BytesIO(content)).parse_crs()
    return None
