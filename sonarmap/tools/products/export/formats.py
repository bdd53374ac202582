"""The formats of other programs. A new format is a writer in a module of its own and a row of FORMATS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

from sonarmap.kernels.errors import InputError
from sonarmap.tools.extras import require
from sonarmap.tools.files.time_scales import TIMES

if TYPE_CHECKING:  # the command line lists the formats in its help, which should appear at once
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from sonarmap.tools.files.map_folder.folder import Map, MapPart
    from sonarmap.tools.products.export.clouds import Cloud
    from sonarmap.tools.products.export.georeferenced import MapGrid


# Kinds of a cell's height: name and description.
HEIGHTS = {
    "top": "mean of the points within one voxel below the cell's highest, weighted by 1 / sigma^2",
    "mean": "mean of the cell's points, weighted by 1 / sigma^2",
    "shoalest": "the cell's highest point",
}


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A format that a map is exported to."""

    file: str  # its name, with {} for the part's suffix
    # "module:function" of tools/products/export. Its arguments are the path and: a `Cloud` if `of_points`; a `MapPart`
    # and the cell if `of_surface`; a `Georeferenced` if the format needs a place; else folder, part, and a
    # `Georeferenced` or None. It returns the details of the side-car
    writer: str
    words: str  # its description
    coordinates: Literal["projected", "geographic", "map"] = "projected"
    of_all_parts: bool = False  # whether one file holds all parts of a map
    of_points: bool = False  # whether it holds points, of the map or of scans, if need be in the map's frame
    of_surface: bool = False  # whether it holds a mesh
    of_grid: bool = False  # whether it holds a grid from above
    needs_crs: bool = False  # whether its grid cannot be in the map's frame
    beside: tuple[str, ...] = ()  # names of further files that the writer may write
    stamps: tuple[float, float] = (-math.inf, math.inf)  # range in which the scans' stamps must lie [s]
    library: str | None = None  # module of an extra of sonarmap that the writer needs

    @property
    def files(self) -> tuple[str, ...]:
        """Names of all its files, with {} for the part's suffix."""
        return self.file, *self.beside

    def name(self, part: MapPart, of_scans: bool) -> str:
        """Name of a part's file; points of scans are named points.laz and so on."""
        name = self.file.format(part.suffix)
        return name.replace("map", "points", 1) if self.of_points and of_scans else name

    @property
    def fits_map_frame(self) -> bool:
        """Whether --crs map writes it in the map's frame."""
        return self.of_points or (self.of_grid and not self.needs_crs)

    @property
    def needs_place(self) -> bool:
        """Whether it can be written only of parts whose place on the Earth is known."""
        return self.coordinates != "map"

    def write(
        self,
        path: Path,
        folder: Map,
        part: MapPart,
        earth: MapGrid | None,
        cloud: Cloud | None = None,
        cell: float | None = None,
    ) -> Mapping[str, Any]:
        """Write one part of a map and return the details of its side-car; `cloud` is for formats of points, `cell` [m]
        for meshes, and `earth` a plain `MapGrid` for a grid in the map's frame."""
        module, function = self.writer.split(":")
        write = getattr(import_module(f"sonarmap.tools.products.export.{module}"), function)
        if self.of_points or self.of_surface:
            return write(path, *((cloud,) if self.of_points else (folder.surface(part), cell)))
        return write(path, *((earth,) if self.needs_place else (folder, part, earth))) or {}


FORMATS = {
    "laz": ExportFormat("map{}.laz", "clouds:write_laz", "points, LAZ 1.4", of_points=True),
    "copc": ExportFormat("map{}.copc.laz", "clouds:write_copc", "points in an octree, COPC 1.0", of_points=True),
    "e57": ExportFormat("map{}.e57", "clouds:write_e57", "points, E57", of_points=True, library="pye57"),
    "xyz": ExportFormat("map{}.xyz", "clouds:write_xyz", "points, a line each, XYZ", of_points=True),
    "geotiff": ExportFormat(
        "grid{}.tif",
        "geotiff:write_geotiff",
        "a grid of heights from above, with vertical uncertainty and count, GeoTIFF, and its style for QGIS",
        of_grid=True,
        beside=("grid{}.qml",),
        library="rasterio",
    ),
    "bag": ExportFormat(
        "grid{}.bag",
        "depths:write_bag",
        "a grid of elevations with their vertical uncertainty, BAG",
        of_grid=True,
        needs_crs=True,
        library="rasterio",
    ),
    "depths": ExportFormat(
        "depths{}.csv",
        "depths:write_depths",
        "a grid of depths, a line per cell: easting, northing, depth, its standard deviation, soundings, CSV",
        of_grid=True,
        needs_crs=True,
    ),
    "kmz": ExportFormat("map{}.kmz", "geotiff:write_kmz", "the track and the map as a picture, KMZ", "geographic"),
    "csv": ExportFormat("poses{}.csv", "track:write_poses_csv", "the scans' positions, attitudes and covariances, CSV"),
    "eiva-position": ExportFormat(
        "eiva_position{}.txt",
        "track:write_eiva_position",
        "the scans' positions for EIVA NaviEdit",
        "geographic",
        stamps=TIMES,  # NaviEdit merges by them
    ),
    "eiva-attitude": ExportFormat(
        "eiva_attitude{}.txt",
        "track:write_eiva_attitude",
        "the scans' attitudes for EIVA NaviEdit",
        "geographic",
        stamps=TIMES,
    ),
    "geojson": ExportFormat("track{}.geojson", "track:write_geojson", "track, scans and loops, GeoJSON", "geographic"),
    "gpkg": ExportFormat(
        "track{}.gpkg", "track:write_geopackage", "track, scans and loops, GeoPackage", library="pyogrio"
    ),
    "mesh-ply": ExportFormat(
        "surface{}.ply", "grid:write_mesh", "a mesh from above, PLY", "map", of_surface=True, library="trimesh"
    ),
    "mesh-glb": ExportFormat(
        "surface{}.glb", "grid:write_mesh", "a mesh from above, GLB", "map", of_surface=True, library="trimesh"
    ),
    "mcap": ExportFormat(
        "map{}.mcap",
        "mcap:write_mcap",
        "cloud, poses, track and positions as messages of ROS 2, MCAP",
        "map",
        stamps=(0.0, 2.0**31),  # of a ROS time
        library="mcap",
    ),
    "g2o": ExportFormat(
        "graph{}.csv",
        "track:write_graph",
        "the pose graph, g2o, and beside it the name, time and frame of its vertices, CSV",
        "map",
        of_all_parts=True,
        beside=("graph{}.g2o",),
    ),
}


def known_formats(names: Iterable[str]) -> list[str]:
    """The named formats without repetition."""
    known: dict[str, None] = {}
    for given in names:
        name = given.strip().lower()
        if name not in FORMATS:
            near = "".join(f"did you mean {other}? Else " for other in get_close_matches(name, FORMATS, 1))
            raise InputError(f"{name!r}; {near}choose from {', '.join(FORMATS)}, several separated by commas")
        if library := FORMATS[name].library:
            require(library)
        known[name] = None
    return list(known)
