"""LAS and LAZ, versions 1.1 to 1.4, by laspy and lazrs: one file is one scan.

Format: https://www.asprs.org/divisions-committees/lidar-division/laser-las-file-format-exchange-activities
"""

from __future__ import annotations

import io
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

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
_DAMAGED = "the file is cut or damaged; copy it again"


def read_las(content: bytes) -> list[Cloud]:
    """The points of a LAS or LAZ file, their intensity as strength, and their GPS times as they are; the stamp is the
    first time in UTC, where the header says that times are adjusted standard GPS time. Raises InputError: a damaged
    file, or map coordinates."""
    (cloud,) = read_map_las(content)
    _refuse_map_coordinates(cloud.points, content)
    return [cloud]


def read_map_las(content: bytes) -> list[Cloud]:
    """The same, also of map coordinates; compressed points by another process, as damage can crash lazrs, or have it
    take all memory."""
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
    if not header.are_points_compressed:
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
