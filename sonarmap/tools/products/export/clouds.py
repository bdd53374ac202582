"""Files of points: XYZ, E57, LAZ 1.4 (point format 6), and COPC 1.0, LAZ in an octree (https://copc.io).

The points are those of the map, or of its scans, never all in memory at once. E57 has float32 coordinates relative to
the scan's pose, float64, which readers add: the sensor's position, or the middle of the map.
"""

import struct
import tempfile
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from importlib import import_module
from importlib.metadata import version
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO
from uuid import NAMESPACE_OID, uuid5

import numpy as np
from scipy.spatial import KDTree

from sonarmap.kernels.errors import InputError
from sonarmap.slam.map.cell import BITS
from sonarmap.slam.map.surface import on_surface
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.geo import Projection
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.files.time_scales import are_times, gps_of_utc
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.georeferenced import Georeferenced

_FORMS = {"f": "%.6g", "i": "%d", "u": "%d"}  # of a column, by the kind of its dtype
_AT_A_TIME = 100_000  # lines that are formatted together
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])  # quaternion w, x, y, z


@dataclass(frozen=True, slots=True)
class Portion:
    """Points that are written together: those of a scan, or all of the map."""

    name: str  # of the scan or the map
    points: np.ndarray  # (N, 3) float64 [m], in the file's coordinates
    in_map: np.ndarray  # (N, 3) float64 [m], the same in the map's frame
    columns: Mapping[str, np.ndarray]  # {name: (N,)}
    stamps: np.ndarray  # (N,) [s], of the points' scans
    place: np.ndarray  # (3,) float64 [m], the sensor or the median of the map's points, in the file's coordinates


@dataclass(frozen=True, slots=True)
class Cloud:
    """The points of one part of a map, or of its scans."""

    folder: Map
    part: MapPart
    earth: Georeferenced | None  # for projected coordinates; None for the map's frame
    scans: Sequence[Scan] | None = None  # all scans of the map, to write their points; None for the map's points
    chosen: tuple[int, ...] | None = None  # indices of the scans to write; None for all

    @property
    def timed(self) -> bool:
        return are_times(self.part.trajectory.stamps)

    @property
    def strongest(self) -> float:
        """The largest echo strength; 0 without echo strengths."""
        of_map: np.ndarray = self.part.columns.get("intensity", np.zeros(0))
        strengths = [of_map] if self.scans is None else [scan.strength for scan in self.scans]
        return max((float(np.max(s, initial=0, where=np.isfinite(s))) for s in strengths if s is not None), default=0.0)

    def placed(self, points: np.ndarray) -> np.ndarray:
        """Points (N, 3) of the map's frame, in the file's coordinates."""
        if self.earth is None:
            return points
        return self.earth.projection.project(self.earth.georeference.geodetic(points))

    def portions(self) -> Iterator[Portion]:
        """The portions that have points; one or more."""
        empty = True
        for name, points, columns, stamps, place in self._whole():
            if len(points):
                empty = False
                yield Portion(name, self.placed(points), points, columns, stamps, self.placed(place[None])[0])
        if empty:
            raise InputError("the chosen scans have no points; choose others")

    def _whole(self) -> Iterator[tuple[str, np.ndarray, Mapping[str, np.ndarray], np.ndarray, np.ndarray]]:
        part = self.part
        if self.scans is None:
            middle = np.median(part.points, axis=0) if len(part.points) else np.zeros(3)
            yield f"map{part.suffix}", part.points, part.columns, part.point_stamps, middle
            return
        surveys = self.folder.surveys(part)
        with_echo = any(scan.strength is not None for scan in self.scans)
        members = [k for k, scan in enumerate(part.scans) if self.chosen is None or scan in self.chosen]
        for k in members:
            number, T = part.scans[k], part.trajectory.T_world_sensor[k]
            scan = self.scans[number]
            points = T.apply(scan.points.astype(np.float64))
            size = len(points)
            columns: dict[str, np.ndarray] = {
                "scan": np.full(size, number, np.int32),
                "survey": np.full(size, surveys[k], np.int32),
            }
            if with_echo:
                columns["intensity"] = np.full(size, np.nan, np.float32) if scan.strength is None else scan.strength
            stamps = np.full(size, part.trajectory.stamps[k])
            yield self.folder.names[number], points, columns, stamps, T.translation


def write_xyz(path: Path, cloud: Cloud) -> Mapping[str, Any]:
    """Write columns separated by blanks, their names after // in the first line, as CloudCompare expects; returns the
    side-car's details."""
    count, names = 0, ()
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="ascii") as file:
        for portion in cloud.portions():
            if not count:
                names = ("x", "y", "z", "stamp", *portion.columns)
                file.write(f"//{' '.join(names)}\n")
            form = " ".join(
                ["%.4f", "%.4f", "%.4f", "%.6f", *(_FORMS[column.dtype.kind] for column in portion.columns.values())]
            )
            for first in range(0, len(portion.points), _AT_A_TIME):
                rows = _rows(portion, slice(first, first + _AT_A_TIME))
                file.writelines(f"{form % row}\n" for row in rows)
            count += len(portion.points)
    return {"points": count, "columns": names, "stamp": "of the scan [s], UTC since 1970 where the scans have times"}


def _rows(portion: Portion, some: slice) -> "zip[tuple[Any, ...]]":
    """Rows of numbers; + 0.0 removes the sign of zeros."""
    places = np.round(portion.points[some], 4) + 0.0
    columns = (column[some].tolist() for column in (*places.T, portion.stamps, *portion.columns.values()))
    return zip(*columns, strict=True)


def write_e57(path: Path, cloud: Cloud) -> Mapping[str, Any]:
    """Write one E57 scan per portion: coordinates, echo strengths if any, and the scan's start as GPS time; returns the
    side-car's details."""
    from pye57 import E57
    from pye57 import e57 as library

    total = 0
    seed = sha256(cloud.part.points.tobytes() + repr(cloud.chosen).encode()).hexdigest()
    with atomic_path(path) as temporary, _guids_from(library, seed):
        temporary.unlink()
        with E57(str(temporary), mode="w") as file:
            for portion in cloud.portions():
                _write_portion(file, portion, cloud.timed and cloud.scans is not None)
                total += len(portion.points)
    return {
        "points": total,
        "scans": "one per scan of the sonar, by its name" if cloud.scans is not None else "one, the map",
        "coordinates": "float32 from the pose's translation, which is float64: the sensor's place, or the map's middle",
        "intensity": "linear echo strength; 0 where there is none",
    }


@contextmanager
def _guids_from(module: Any, seed: str) -> Generator[None]:
    """Replace pye57's random GUIDs by ones that follow from the content, so that the same map gives the same bytes."""
    original, number = module.uuid, count()
    module.uuid = SimpleNamespace(uuid4=lambda: uuid5(NAMESPACE_OID, f"{seed} {next(number)}"))
    try:
        yield
    finally:
        module.uuid = original


def _write_portion(file: Any, portion: Portion, timed: bool) -> None:
    places = portion.points - portion.place
    columns: dict[str, np.ndarray] = {f"cartesian{axis}": column for axis, column in zip("XYZ", places.T, strict=True)}
    if "intensity" in portion.columns:
        columns["intensity"] = np.nan_to_num(portion.columns["intensity"])
    bounds = {f"{axis}Minimum": least for axis, least in zip("xyz", portion.points.min(axis=0).tolist(), strict=True)}
    bounds |= {f"{axis}Maximum": most for axis, most in zip("xyz", portion.points.max(axis=0).tolist(), strict=True)}
    if timed:
        bounds["acquisitionStart_dateTimeValue"] = float(gps_of_utc(portion.stamps[:1])[0])
    header = SimpleNamespace(**bounds)
    file.write_scan_raw(columns, name=portion.name, rotation=_UPRIGHT, translation=portion.place, scan_header=header)


_SCALE = 0.001  # [m]
_STANDARD_GPS = 1e9  # adjusted standard GPS time is GPS time less this [s]
_DIAGONAL = 1.75  # of a voxel [edges], rounded up
_BRIGHTEST = 65_535  # largest intensity of 16 bits
_DIMENSIONS = {  # extra dimensions of a LAS file: type, and description of at most 31 letters
    "sigma": ("f4", "std. deviation of a coord. [m]"),
    "count": ("u4", "sonar points in the voxel"),
    "seen": ("u2", "scans that saw the voxel"),
    "scan": ("u4", "scan with most of its points"),
    "survey": ("u2", "survey of that scan"),
}
_CELLS = 128  # along a node's edge; the node keeps one point of each, and its children the others
_FEW = 50_000  # largest number of points that a node keeps whole, without children
_DEEPEST = 12  # depth of the octree
_INFO, _ENTRY = "<5d2Q2d88x", "<4iQ2i"  # of the specification: sections "info VLR" and "hierarchy VLR"


# LAS classes: bathymetric point, of the bed or of an object on it; and low point (noise)
BATHYMETRIC, NOISE = 40, 7


def write_laz(path: Path, cloud: Cloud) -> Mapping[str, Any]:
    """Write LAZ 1.4, portion by portion: x, y and z [m] to the millimeter, CRS as WKT 1; returns the side-car's
    details."""
    import laspy

    header, scale, classes = cloud_header(cloud), intensity_scale(cloud), las_classes(cloud)
    with (
        atomic_path(path) as temporary,
        temporary.open("wb") as file,
        laspy.open(file, mode="w", header=header, do_compress=True, closefd=False) as writer,
    ):
        for portion in cloud.portions():
            writer.write_points(las_points(portion, header, scale, cloud.timed, classes))
    return meaning(cloud, int(writer.header.point_count))


def cloud_header(cloud: Cloud) -> Any:
    part, survey = cloud.part, max(cloud.folder.surveys(cloud.part)) > 0 or cloud.part.columns["survey"].any()
    names = ("sigma", "count", "seen", "scan", "survey") if cloud.scans is None else ("scan", "survey")
    dimensions = {name: _DIMENSIONS[name] for name in names if name != "survey" or survey}
    least = cloud.placed(part.points).min(axis=0) if len(part.points) else np.zeros(3)
    return las_header(None if cloud.earth is None else cloud.earth.projection, least, dimensions, cloud.timed)


def las_classes(cloud: Cloud) -> Callable[[np.ndarray], np.ndarray]:
    """A function from points (N, 3) in the map's frame to their classes (N,): that of the map's nearest point, which is
    BATHYMETRIC on a surface, else NOISE. A point of a scan is NOISE too if no point of the map lies within the diagonal
    of a voxel: the map left it out as doubtful."""
    part, voxel = cloud.part, cloud.folder.voxel
    classes = np.append(np.where(on_surface(part.points, voxel), BATHYMETRIC, NOISE), NOISE)  # the last: none is near
    tree = KDTree(part.points)
    return lambda points: classes[tree.query(points, distance_upper_bound=_DIAGONAL * voxel)[1]]


def las_points(
    portion: Portion,
    header: Any,
    scale: float | None,
    timed: bool,
    classes: Callable[[np.ndarray], np.ndarray],
) -> Any:
    """The points of a portion as a laspy record; echo strengths are multiplied by `scale`."""
    import laspy

    points, columns = laspy.ScaleAwarePointRecord.zeros(len(portion.points), header=header), portion.columns
    points.x, points.y, points.z = portion.points.T
    points.return_number[:] = 1
    points.number_of_returns[:] = 1
    points.classification = classes(portion.in_map)
    points.point_source_id = columns["scan"].astype(np.int64) % 65_536
    points.gps_time = gps_times(portion.stamps, timed)
    if scale is not None and "intensity" in columns:
        strengths = np.nan_to_num(columns["intensity"].astype(np.float64))
        points.intensity = np.rint(np.clip(strengths * scale, 0, _BRIGHTEST)).astype(np.uint16)
    for name in header.point_format.extra_dimension_names:
        points[name] = _within(columns[name], _DIMENSIONS[name][0])
    return points


def intensity_scale(cloud: Cloud) -> float | None:
    """Factor from echo strengths to 16 bits, the strongest to the largest number; None without echo strengths."""
    strongest = cloud.strongest
    return _BRIGHTEST / strongest if strongest > 0 else None


def meaning(cloud: Cloud, count: int) -> dict[str, Any]:
    """Details of a LAS file's side-car: the number of points and the meaning of its dimensions."""
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
        "classification": f"{BATHYMETRIC} (bathymetric point): on a surface, of the bed or of an object; {NOISE} (low "
        "point, noise): a stray echo, or a point of a scan that the map leaves out",
    }


def las_header(
    projection: Projection | None, least: np.ndarray, dimensions: Mapping[str, tuple[str, str]], timed: bool
) -> Any:
    """Header of a LAS 1.4 file of point format 6, to the millimeter, with its CRS, if any, as WKT 1.

    Args:
        projection: of the coordinates; None for a map's frame.
        least: (3,) easting, northing, height [m] near the points, the file's offsets.
        dimensions: extra dimensions: type, and description of at most 31 letters.
        timed: whether times are those of `gps_times`.
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
    """(N,) adjusted standard GPS time [s] of stamps [s, UTC]; the stamps themselves if they are not times."""
    return gps_of_utc(stamps) - _STANDARD_GPS if timed else stamps


def _within(column: np.ndarray, kind: str) -> np.ndarray:
    """The column converted to the type `kind`, clipped to its largest number."""
    dtype = np.dtype(kind)
    if dtype.kind == "f":
        return column.astype(dtype)
    return np.minimum(column.astype(np.float64), np.iinfo(dtype).max).astype(dtype)


def write_copc(path: Path, cloud: Cloud) -> Mapping[str, Any]:
    """Write the points of `write_laz` as COPC; returns the side-car's details. Coordinates and their order are held in
    memory, about 130 bytes per point, and the rest on disk."""
    header, scale, places = cloud_header(cloud), intensity_scale(cloud), list[np.ndarray]()
    classes = las_classes(cloud)
    with tempfile.TemporaryFile(prefix="sonarmap.") as file, atomic_path(path) as temporary:
        for portion in cloud.portions():
            points = las_points(portion, header, scale, cloud.timed, classes)
            header.grow(points)
            places.append(np.column_stack([points.array[axis] for axis in "XYZ"]))
            file.write(points.array.tobytes())
        file.flush()
        records = np.memmap(file, header.point_format.dtype(), "r")
        with temporary.open("w+b") as out:
            _write(out, header, np.concatenate(places), records)
    return meaning(cloud, len(records))


def _write(file: BinaryIO, header: Any, places: np.ndarray, records: np.ndarray) -> None:
    """Write the header, a chunk for each node, and the hierarchy; then the header again with their offsets."""
    import laspy
    from laspy.vlrs.known import LasZipVlr
    from laspy.vlrs.vlrlist import VLRList

    lazrs: Any = import_module("lazrs")
    low = places.min(axis=0)
    # the extent from `grow` includes 0
    header.mins, header.maxs = (corner * header.scales + header.offsets for corner in (low, places.max(axis=0)))
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
    for key, (number, size) in zip(keys, lazrs.read_chunk_table(file, laz), strict=True):
        entries += struct.pack(_ENTRY, *key, place, size, number)
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
    """Depth, x, y and z of every node, and the indices (k,) of its points, of places (N, 3) int32 from 0 to `edge`."""
    rest = np.arange(len(places), dtype=np.int32)
    for depth in range(_DEEPEST + 1):
        node, cell = np.zeros(len(rest), np.int64), np.zeros(len(rest), np.int64)
        for axis in range(3):
            step = places[rest, axis].astype(np.int64) * (_CELLS << depth) // edge
            node, cell = node << BITS | step // _CELLS, cell << BITS | step
        nodes, inverse, size = np.unique(node, return_inverse=True, return_counts=True)
        kept = (size <= _FEW)[inverse] if depth < _DEEPEST else np.ones(len(rest), bool)
        kept[np.unique(cell, return_index=True)[1]] = True
        order = np.flatnonzero(kept)[np.argsort(inverse[kept], kind="stable")]
        ends = np.cumsum(np.bincount(inverse[kept], minlength=len(nodes)))
        for key, chosen in zip(nodes.tolist(), np.split(rest[order], ends[:-1]), strict=True):
            x, y, z = (key >> BITS * k & (1 << BITS) - 1 for k in (2, 1, 0))
            yield (depth, x, y, z), chosen
        rest = rest[~kept]
        if not len(rest):
            return
