"""The formats of other programs. A new one is a writer in a module of its own and a row of FORMATS."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from sonarmap.tools.files.time_scales import TIMES

if TYPE_CHECKING:  # the command line names the formats in its help, which is to come at once
    from pathlib import Path

    from sonarmap.tools.files.map_folder.folder import MapFolder, MapPart
    from sonarmap.tools.products.export.georeferenced import Georeferenced

    # The file, the map, one part of it, and that part on the Earth (None: its place is not known)
    Writer: TypeAlias = Callable[[Path, MapFolder, MapPart, Georeferenced | None], None]
    Details: TypeAlias = Callable[[MapPart, Georeferenced | None], Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A format that a map is exported to.

    Attributes:
        file: its name, with a place for the part's suffix.
        write: writes it.
        needs_place: whether it holds places on the Earth, so that a part without one cannot be written.
        words: what it is.
        coordinates: which its numbers are: projected, latitude and longitude, or the map's own.
        details: what its side-car says beside what all of them say.
        of_all_parts: whether one file is about all parts of a map.
        beside: the names of further files that `write` may write.
        stamps: from where on and up to where the scans' stamps must lie [s].
    """

    file: str
    write: Writer
    needs_place: bool
    words: str
    coordinates: Literal["projected", "geographic", "map"] = "projected"
    details: Details | None = None
    of_all_parts: bool = False
    beside: tuple[str, ...] = ()
    stamps: tuple[float, float] = (-math.inf, math.inf)

    @property
    def files(self) -> tuple[str, ...]:
        """The names of all its files, each with a place for the part's suffix."""
        return self.file, *self.beside


def _late(module: str, function: str) -> Callable[..., Any]:
    """A function of tools/products/export that is loaded when it is called."""

    def call(*arguments: Any) -> Any:
        return getattr(import_module(f"sonarmap.tools.products.export.{module}"), function)(*arguments)

    return call


FORMATS = {
    "laz": ExportFormat(
        "map{}.laz",
        _late("laz", "write_laz"),
        needs_place=True,
        words="the map's points, LAZ 1.4",
        details=_late("laz", "laz_details"),
    ),
    "geotiff": ExportFormat(
        "grid{}.tif",
        _late("geotiff", "write_geotiff"),
        needs_place=True,
        words="a grid of heights from above, with standard deviation and count, GeoTIFF, and its style for QGIS",
        details=_late("geotiff", "geotiff_details"),
        beside=("grid{}.qml",),
    ),
    "kml": ExportFormat(
        "map{}.kml",
        _late("kml.write", "write_kml"),
        needs_place=True,
        words="the track, KML 2.2",
        coordinates="geographic",
    ),
    "kmz": ExportFormat(
        "map{}.kmz",
        _late("kml.write", "write_kmz"),
        needs_place=True,
        words="the track and the map as a picture, KMZ",
        coordinates="geographic",
        details=_late("kml.write", "kmz_details"),
    ),
    "csv": ExportFormat(
        "poses{}.csv",
        _late("poses_csv", "write_poses_csv"),
        needs_place=True,
        words="the scans' positions, attitudes and covariances, CSV",
    ),
    "eiva-position": ExportFormat(
        "eiva_position{}.txt",
        _late("eiva", "write_eiva_position"),
        needs_place=True,
        words="the scans' positions for EIVA NaviEdit",
        coordinates="geographic",
        stamps=TIMES,  # NaviEdit merges by them
    ),
    "eiva-attitude": ExportFormat(
        "eiva_attitude{}.txt",
        _late("eiva", "write_eiva_attitude"),
        needs_place=True,
        words="the scans' attitudes for EIVA NaviEdit",
        coordinates="geographic",
        stamps=TIMES,
    ),
    "geojson": ExportFormat(
        "track{}.geojson",
        _late("geojson", "write_geojson"),
        needs_place=True,
        words="track, scans and loops, GeoJSON",
        coordinates="geographic",
    ),
    "gpkg": ExportFormat(
        "track{}.gpkg",
        _late("geopackage", "write_geopackage"),
        needs_place=True,
        words="track, scans and loops, GeoPackage",
    ),
    "mcap": ExportFormat(
        "map{}.mcap",
        _late("mcap", "write_mcap"),
        needs_place=False,
        words="cloud, poses, track and positions as messages of ROS 2, MCAP",
        coordinates="map",
        stamps=(0.0, 2.0**31),  # of a ROS time
    ),
    "pcd": ExportFormat(
        "map{}.pcd",
        _late("plain", "write_cloud"),
        needs_place=False,
        words="the map's points, PCD 0.7 in float32 beside an origin",
        coordinates="map",
    ),
    "tum": ExportFormat(
        "trajectory{}.tum",
        _late("plain", "write_poses"),
        needs_place=False,
        words="the poses with their times, TUM",
        coordinates="map",
    ),
    "kitti": ExportFormat(
        "trajectory{}.kitti",
        _late("plain", "write_poses"),
        needs_place=False,
        words="the poses as 3x4 matrices, KITTI",
        coordinates="map",
    ),
    "g2o": ExportFormat(
        "graph{}.csv",
        _late("graph_csv", "write_graph"),
        needs_place=False,
        words="the pose graph, g2o, and beside it the name, time and frame of its vertices, CSV",
        coordinates="map",
        of_all_parts=True,
        beside=("graph{}.g2o",),
    ),
}
