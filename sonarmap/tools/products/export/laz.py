# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""LAZ 1.4, point format 6: the map's points, projected, with what map.ply says of each."""

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.files.geo.projection import Projection
from sonarmap.tools.files.map_folder.folder import MapPart
from sonarmap.tools.files.time_scales import gps_of_utc
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.georeferenced import Georeferenced

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


def write_laz(path: Path, earth: Georeferenced) -> Mapping[str, Any]:
    """Write the points of a part as LAZ 1.4: easting, northing and height [m] to the millimeter, CRS as WKT 1; returns
    what the other numbers mean."""
    import laspy

    part, projected = earth.part, earth.projected_points
    dimensions = {name: _DIMENSIONS[name] for name in _DIMENSIONS if name != "survey" or part.columns["survey"].any()}
    least = projected.min(axis=0) if len(projected) else np.zeros(3)
    header = las_header(earth.projection, least, dimensions, earth.timed)
    las = laspy.LasData(header)
    las.points = laspy.ScaleAwarePointRecord.zeros(len(projected), header=header)
    las.x, las.y, las.z = projected.T
    _fill(las, part, earth.timed)
    for name, (kind, _) in dimensions.items():
        las[name] = _within(part.columns[name], kind)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        las.write(file, do_compress=True)
    scale = _intensity_scale(part)
    return {
        "gps_time": "adjusted standard GPS time (GPS seconds less 1e9) of the scan with most of the voxel's points"
        if earth.timed
        else "the stamp of the scan with most of the voxel's points [s]; the scans have no times since 1970",
        "intensity": None
        if scale is None
        else f"linear echo strength times {scale!r}, in 16 bits; 0 where there is none",
        "point_source_id": "the scan modulo 65536; the extra dimension scan has its whole number",
        "extra_dimensions": {name: words for name, (_, words) in _DIMENSIONS.items()},
        "classification": "0, never classified",
    }


def las_header(
    projection: Projection, least: np.ndarray, dimensions: Mapping[str, tuple[str, str]], timed: bool
) -> Any:
    """The header of a LAS 1.4 file of point format 6, to the millimeter, with its CRS as WKT 1.

    Args:
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
    header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(projection.old_wkt))
    header.global_encoding.wkt = True
    if timed:
        header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    return header


def gps_times(stamps: np.ndarray, timed: bool) -> np.ndarray:
    """(N,) adjusted standard GPS time [s] of stamps [s, UTC]; the stamps where they are no times."""
    return gps_of_utc(stamps) - _STANDARD_GPS if timed else stamps


def _fill(las: Any, part: MapPart, timed: bool) -> None:
    """The dimensions that every LAS file has."""
    las.return_number[:] = 1
    las.number_of_returns[:] = 1
    las.point_source_id = part.columns["scan"].astype(np.int64) % 65_536
    stamps = part.point_stamps
    las.gps_time = gps_times(stamps, timed)
    scale = _intensity_scale(part)
    if scale is not None:
        strengths = np.nan_to_num(part.columns["intensity"].astype(np.float64))
        las.intensity = np.rint(np.clip(strengths * scale, 0, _BRIGHTEST)).astype(np.uint16)


def _intensity_scale(part: MapPart) -> float | None:
    """What brings the strongest echo to the largest number of 16 bits; None where there are no echo strengths."""
    strengths = part.columns.get("intensity", np.zeros(0))
    strongest = float(strengths[np.isfinite(strengths)].max(initial=0.0))
    return _BRIGHTEST / strongest if strongest > 0 else None


def _within(column: np.ndarray, kind: str) -> np.ndarray:
    """The column in this type, what is beyond its largest number as that."""
    dtype = np.dtype(kind)
    if dtype.kind == "f":
        return column.astype(dtype)
    return np.minimum(column.astype(np.float64), np.iinfo(dtype).max).astype(dtype)
