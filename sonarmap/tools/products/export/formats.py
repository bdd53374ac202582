"""The formats of other programs. A new one is a writer in a module of its own and a row of FORMATS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

from sonarmap.tools.files.time_scales import TIMES

if TYPE_CHECKING:  # the command line names the formats in its help, which is to come at once
    from collections.abc import Mapping
    from pathlib import Path

    from sonarmap.tools.files.map_folder.folder import MapFolder, MapPart
    from sonarmap.tools.products.export.georeferenced import Georeferenced


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A format that a map is exported to."""

    file: str  # its name, with a place for the part's suffix
    # "module:function" of tools/products/export, called with the file's path and a `Georeferenced` where the format
    # needs a place, else folder, part, and `Georeferenced` or None; returns what the side-car says beyond what all say
    writer: str
    words: str  # what it is
    # which its numbers are: projected, latitude and longitude, or the map's own
    coordinates: Literal["projected", "geographic", "map"] = "projected"
    of_all_parts: bool = False  # whether one file is about all parts of a map
    of_poses: bool = False  # whether it holds poses and nothing of scans, so that they may be at a rate of their own
    beside: tuple[str, ...] = ()  # the names of further files that the writer may write
    stamps: tuple[float, float] = (-math.inf, math.inf)  # from where on and up to where the scans' stamps must lie [s]

    @property
    def files(self) -> tuple[str, ...]:
        """The names of all its files, each with a place for the part's suffix."""
        return self.file, *self.beside

    @property
    def needs_place(self) -> bool:
        """Whether it holds places on the Earth, so that a part without one cannot be written."""
        return self.coordinates != "map"

    def write(self, path: Path, folder: MapFolder, part: MapPart, earth: Georeferenced | None) -> Mapping[str, Any]:
        """Write one part of a map, and return what its side-car says beyond what all of them say.

        Raises InputError: a file cannot be written."""
        module, function = self.writer.split(":")
        write = getattr(import_module(f"sonarmap.tools.products.export.{module}"), function)
        return write(path, *((earth,) if self.needs_place else (folder, part, earth))) or {}


FORMATS = {
    "laz": ExportFormat("map{}.laz", "laz:write_laz", "the map's points, LAZ 1.4"),
    "geotiff": ExportFormat(
        "grid{}.tif",
        "geotiff:write_geotiff",
        "a grid of heights from above, with standard deviation and count, GeoTIFF, and its style for QGIS",
        beside=("grid{}.qml",),
    ),
    "kml": ExportFormat("map{}.kml", "kml:write_kml", "the track, KML 2.2", "geographic"),
    "kmz": ExportFormat("map{}.kmz", "kml:write_kmz", "the track and the map as a picture, KMZ", "geographic"),
    "csv": ExportFormat(
        "poses{}.csv",
        "tables:write_poses_csv",
        "the scans' positions, attitudes and covariances, CSV",
        of_poses=True,
    ),
    "eiva-position": ExportFormat(
        "eiva_position{}.txt",
        "tables:write_eiva_position",
        "the scans' positions for EIVA NaviEdit",
        "geographic",
        of_poses=True,
        stamps=TIMES,  # NaviEdit merges by them
    ),
    "eiva-attitude": ExportFormat(
        "eiva_attitude{}.txt",
        "tables:write_eiva_attitude",
        "the scans' attitudes for EIVA NaviEdit",
        "geographic",
        of_poses=True,
        stamps=TIMES,
    ),
    "geojson": ExportFormat(
        "track{}.geojson", "track_features:write_geojson", "track, scans and loops, GeoJSON", "geographic"
    ),
    "gpkg": ExportFormat("track{}.gpkg", "track_features:write_geopackage", "track, scans and loops, GeoPackage"),
    "mcap": ExportFormat(
        "map{}.mcap",
        "mcap:write_mcap",
        "cloud, poses, track and positions as messages of ROS 2, MCAP",
        "map",
        stamps=(0.0, 2.0**31),  # of a ROS time
    ),
    "pcd": ExportFormat(
        "map{}.pcd", "tables:write_cloud", "the map's points, PCD 0.7 in float32 beside an origin", "map"
    ),
    "tum": ExportFormat(
        "trajectory{}.tum", "tables:write_poses", "the poses with their times, TUM", "map", of_poses=True
    ),
    "kitti": ExportFormat(
        "trajectory{}.kitti", "tables:write_poses", "the poses as 3x4 matrices, KITTI", "map", of_poses=True
    ),
    "g2o": ExportFormat(
        "graph{}.csv",
        "tables:write_graph",
        "the pose graph, g2o, and beside it the name, time and frame of its vertices, CSV",
        "map",
        of_all_parts=True,
        beside=("graph{}.g2o",),
    ),
}
