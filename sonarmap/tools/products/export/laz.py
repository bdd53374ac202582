"""LAZ 1.4, point format 6: points, projected, with what else is known of each; and COPC 1.0, the same points in an
octree, so that programs read what they show alone (https://copc.io)."""

import struct
import tempfile
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sonarmap.slam.map.cell import BITS
from sonarmap.tools.files.geo.projection import Projection
from sonarmap.tools.files.time_scales import gps_of_utc
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.clouds import Cloud, Portion

_SCALE = 0.001  # [m]
_STANDARD_GPS = 1e9  # adjusted standard GPS time is GPS time less this [s]
_BRIGHTEST = 65_535  # intensity has 16 bits
_DIMENSIONS = {  # beside those that every LAS file has: type, and what it is in at most 31 letters
    "sigma": ("f4", "std. deviation of a coord. [m]"),
    "count": ("u4", "sonar points in the voxel"),
    "seen": ("u2", "scans that saw the voxel"),
    "scan": ("u4", "scan with most of its points"),
    "survey": ("u2", "survey of that scan"),
}
# Cells along a node's edge, in each of which it keeps one point; the others go to its children, unless they are few.
_CELLS, _FEW, _DEEPEST = 128, 50_000, 12
_INFO, _ENTRY = "<5d2Q2d88x", "<4iQ2i"  # of the specification: sections "info VLR" and "hierarchy VLR"


def write_laz(path: Path, cloud: Cloud) -> Mapping[str, Any]:
    """Write points as LAZ 1.4, portion by portion: x, y and z [m] to the millimeter, CRS as WKT 1; returns what the
    other numbers mean."""
    import laspy

    header, scale = cloud_header(cloud), intensity_scale(cloud)
    with (
        atomic_path(path) as temporary,
        temporary.open("wb") as file,
        laspy.open(file, mode="w", header=header, do_compress=True, closefd=False) as writer,
    ):
        for portion in cloud.portions():
            writer.write_points(las_points(portion, header, scale, cloud.timed))
    return meaning(cloud, int(writer.header.point_count))


def cloud_header(cloud: Cloud) -> Any:
    part, survey = cloud.part, max(cloud.folder.surveys(cloud.part)) > 0 or cloud.part.columns["survey"].any()
    names = ("sigma", "count", "seen", "scan", "survey") if cloud.scans is None else ("scan", "survey")
    dimensions = {name: _DIMENSIONS[name] for name in names if name != "survey" or survey}
    least = cloud.placed(part.points).min(axis=0) if len(part.points) else np.zeros(3)
    return las_header(None if cloud.earth is None else cloud.earth.projection, least, dimensions, cloud.timed)


def las_points(portion: Portion, header: Any, scale: float | None, timed: bool) -> Any:
    """The points of a portion as laspy has them; `scale` is what echo strengths are multiplied by."""
    import laspy

    points, columns = laspy.ScaleAwarePointRecord.zeros(len(portion.points), header=header), portion.columns
    points.x, points.y, points.z = portion.points.T
    points.return_number[:] = 1
    points.number_of_returns[:] = 1
    points.point_source_id = columns["scan"].astype(np.int64) % 65_536
    points.gps_time = gps_times(portion.stamps, timed)
    if scale is not None and "intensity" in columns:
        strengths = np.nan_to_num(columns["intensity"].astype(np.float64))
        points.intensity = np.rint(np.clip(strengths * scale, 0, _BRIGHTEST)).astype(np.uint16)
    for name in header.point_format.extra_dimension_names:
        points[name] = _within(columns[name], _DIMENSIONS[name][0])
    return points


def intensity_scale(cloud: Cloud) -> float | None:
    """What brings the strongest echo to the largest number of 16 bits; None where there are no echo strengths."""
    strongest = cloud.strongest
    return _BRIGHTEST / strongest if strongest > 0 else None


def meaning(cloud: Cloud, count: int) -> dict[str, Any]:
    """What the numbers of a LAS file of a cloud mean, and how many points it has."""
    whose = "the scan" if cloud.scans is not None else "the scan with most of the voxel's points"
    scale = intensity_scale(cloud)
    return {
        "points": count,
        "gps_time": f"adjusted standard GPS time (GPS seconds less 1e9) of {whose}"
        if cloud.timed
        else f"the stamp of {whose} [s]; the scans have no times since 1970",
        "intensity": None
        if scale is None
        else f"linear echo strength times {scale!r}, in 16 bits; 0 where there is none",
        "point_source_id": "the scan modulo 65536; the extra dimension scan has its whole number",
        "extra_dimensions": {name: words for name, (_, words) in _DIMENSIONS.items()},
        "classification": "0, never classified",
    }


def las_header(
    projection: Projection | None, least: np.ndarray, dimensions: Mapping[str, tuple[str, str]], timed: bool
) -> Any:
    """The header of a LAS 1.4 file of point format 6, to the millimeter, with its CRS, if any, as WKT 1.

    Args:
        projection: of the coordinates; None for a map's own.
        least: (3,) easting, northing, height [m] near the points, from which they are counted.
        dimensions: beside those of every LAS file: type, and what it is in at most 31 letters.
        timed: whether points have times, as `gps_times` has them.
    """
    import laspy

    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, _SCALE), np.floor(least)
    header.system_identifier = "OTHER"
    header.generating_software = f"sonarmap {version('sonarmap')}"
    header.add_extra_dims([laspy.ExtraBytesParams(name, kind, words) for name, (kind, words) in dimensions.items()])
    if projection is not None:
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(projection.old_wkt))
    header.global_encoding.wkt = True
    if timed:
        header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    return header


def gps_times(stamps: np.ndarray, timed: bool) -> np.ndarray:
    """(N,) adjusted standard GPS time [s] of stamps [s, UTC]; the stamps where they are no times."""
    return gps_of_utc(stamps) - _STANDARD_GPS if timed else stamps


def _within(column: np.ndarray, kind: str) -> np.ndarray:
    """The column in this type, what is beyond its largest number as that."""
    dtype = np.dtype(kind)
    if dtype.kind == "f":
        return column.astype(dtype)
    return np.minimum(column.astype(np.float64), np.iinfo(dtype).max).astype(dtype)


def write_copc(path: Path, cloud: Cloud) -> Mapping[str, Any]:
    """Write the points that `write_laz` writes; returns what their numbers mean. Their places are in memory, about 130
    bytes for each point with what sorts them, and the rest on disk."""
    header, scale, places = cloud_header(cloud), intensity_scale(cloud), list[np.ndarray]()
    with tempfile.TemporaryFile(prefix="sonarmap.") as file, atomic_path(path) as temporary:
        for portion in cloud.portions():
            points = las_points(portion, header, scale, cloud.timed)
            header.grow(points)
            places.append(np.column_stack([points.array[axis] for axis in "XYZ"]))
            file.write(points.array.tobytes())
        file.flush()
        records = np.memmap(file, header.point_format.dtype(), "r")
        with temporary.open("w+b") as out:
            _write(out, header, np.concatenate(places), records)
    return meaning(cloud, len(records))


def _write(file: BinaryIO, header: Any, places: np.ndarray, records: np.ndarray) -> None:
    """Write the header, a chunk for each node, and where these are; then the header again, which says that too."""
    import laspy
    from laspy.vlrs.known import LasZipVlr
    from laspy.vlrs.vlrlist import VLRList

    lazrs: Any = import_module("lazrs")
    low = places.min(axis=0)
    # `grow` begins at 0
    header.mins, header.maxs = (each * header.scales + header.offsets for each in (low, places.max(axis=0)))
    places -= low
    edge = int(places.max()) + 1
    half = edge * float(header.scales[0]) / 2
    extra = header.point_format.num_extra_bytes
    laz = lazrs.LazVlr.new_for_compression(header.point_format.id, extra, use_variable_size_chunks=True)
    info = laspy.VLR("copc", 1, "COPC info", bytes(struct.calcsize(_INFO)))
    header.vlrs[:0] = [info, LasZipVlr(laz.record_data())]  # the info comes first
    header.are_points_compressed = True
    header.write_to(file)
    compressor = lazrs.LasZipCompressor(file, laz)
    compressor.reserve_offset_to_chunk_table()
    keys: list[tuple[int, int, int, int]] = []
    for key, chosen in _nodes(places, edge):
        if keys:
            compressor.finish_current_chunk()
        compressor.compress_many(np.frombuffer(records[chosen].tobytes(), np.uint8))
        keys.append(key)
    compressor.done()
    end = file.seek(0, 2)
    file.seek(header.offset_to_point_data)
    place, entries = header.offset_to_point_data + 8, b""
    for key, (count, size) in zip(keys, lazrs.read_chunk_table(file, laz), strict=True):
        entries += struct.pack(_ENTRY, *key, place, size, count)
        place += size
    times = records["gps_time"]
    middle = low * header.scales + header.offsets + half
    where = end + 60, len(entries)  # behind the head of the record
    header.vlrs[0].record_data = struct.pack(_INFO, *middle, half, 2 * half / _CELLS, *where, times.min(), times.max())
    header.number_of_evlrs, header.start_of_first_evlr = 1, end
    file.seek(end)
    VLRList([laspy.VLR("copc", 1000, "EPT hierarchy", entries)]).write_to(file, as_extended=True)
    file.seek(0)
    header.write_to(file)


def _nodes(places: np.ndarray, edge: int) -> Iterator[tuple[tuple[int, int, int, int], np.ndarray]]:
    """Depth, x, y and z of every node, and which points (k,) it has, of places (N, 3) int32 from 0 below `edge`."""
    left = np.arange(len(places), dtype=np.int32)
    for depth in range(_DEEPEST + 1):
        node, cell = np.zeros(len(left), np.int64), np.zeros(len(left), np.int64)
        for axis in range(3):
            step = places[left, axis].astype(np.int64) * (_CELLS << depth) // edge
            node, cell = node << BITS | step // _CELLS, cell << BITS | step
        nodes, inverse, size = np.unique(node, return_inverse=True, return_counts=True)
        kept = (size <= _FEW)[inverse] if depth < _DEEPEST else np.ones(len(left), bool)
        kept[np.unique(cell, return_index=True)[1]] = True
        order = np.flatnonzero(kept)[np.argsort(inverse[kept], kind="stable")]
        ends = np.cumsum(np.bincount(inverse[kept], minlength=len(nodes)))
        for key, chosen in zip(nodes.tolist(), np.split(left[order], ends[:-1]), strict=True):
            x, y, z = (key >> BITS * k & (1 << BITS) - 1 for k in (2, 1, 0))
            yield (depth, x, y, z), chosen
        left = left[~kept]
        if not len(left):
            return
