# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""LAZ 1.4, point format 6: points, projected, with what else is known of each."""

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.files.geo.projection import Projection
from sonarmap.tools.files.time_scales import gps_of_utc
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.clouds.cloud import Cloud, Portion

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
    """The header of a LAS file of a cloud."""
    part, survey = cloud.part, max(cloud.folder.surveys(cloud.part)) > 0 or cloud.part.columns["survey"].any()
    names = ("sigma", "count", "seen", "scan", "survey") if cloud.scans is None else ("scan", "survey")
    dimensions = {name: _DIMENSIONS[name] for name in names if name != "survey" or survey}
    least = cloud.placed(part.points).min(axis=0) if len(part.points) else np.zeros(3)
    return las_header(cloud.earth and cloud.earth.projection, least, dimensions, cloud.timed)


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
