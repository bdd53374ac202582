"""Grids of depths with their vertical uncertainty: BAG 1.6, and CSV in surveyors' order.

A BAG (Bathymetric Attributed Grid) is HDF5 with metadata in XML, here written by GDAL. Its format is defined by the
Format Specification Document of the Open Navigation Surface Working Group, https://github.com/OpenNavigationSurface/BAG.
"""

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import VERTICALS
from sonarmap.tools.files.time_scales import utc_text
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.files.writers.tables import write_table
from sonarmap.tools.products.export.formats import HEIGHTS
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.geotiff import VERTICAL_UNCERTAINTY, fill, gdal_writes, layout, read_whole

UNKNOWN = 1e6  # elevation and uncertainty of a node without points
# of the specification's table 1: a standard deviation of the soundings that contributed to the node
UNCERTAINTY_TYPE = "rawStdDev"
COLUMNS = ("easting_m", "northing_m", "depth_m", "depth_sigma_m", "soundings")


def write_bag(path: Path, grid: Georeferenced) -> Mapping[str, Any]:
    """Write heights of the kind `grid.height` and their standard deviations as BAG; return the side-car's details.

    Nodes are the middles of the GeoTIFF's cells. Raises InputError: this rasterio has no driver of BAG."""
    import rasterio

    with rasterio.Env() as gdal:
        if "BAG" not in gdal.drivers():
            raise InputError("this rasterio's GDAL has no BAG driver; install rasterio from PyPI, or export geotiff")
    profile: dict[str, Any] = {"driver": "BAG", "dtype": "float32", "count": 2, "nodata": UNKNOWN, **_metadata(grid)}
    crs = grid.projection.crs.to_wkt()
    with atomic_path(path) as temporary, gdal_writes(path):
        with rasterio.open(temporary, "w", crs=crs, **layout(grid.depth_grid), **profile) as raster:
            fill(raster, grid.depth_grid, ("height", "sigma"))
        read_whole(temporary)
    return {
        "elevation": f"height [m], positive up: {HEIGHTS[grid.height]}",
        "uncertainty": f"{VERTICAL_UNCERTAINTY} [m]; its type is {UNCERTAINTY_TYPE}",
        **grid.coverage,
        "nodata": UNKNOWN,
    }


def _metadata(grid: Georeferenced) -> dict[str, Any]:
    """Variables of GDAL's template of the metadata, which becomes ISO 19139."""
    vertical = VERTICALS[grid.georeference.vertical]
    last = utc_text(float(grid.stamps.max())) if grid.timed else None
    dated = f"<gmd:CI_Date><gmd:date><gco:Date>{last[:10]}</gco:Date></gmd:date></gmd:CI_Date>" if last else ""
    title = escape(f"{grid.folder.path.resolve().name} map{grid.part.suffix}")
    return {
        "VAR_VERT_WKT": grid.projection.vertical_wkt,
        "VAR_VERTICAL_UNCERT_CODE": UNCERTAINTY_TYPE,
        "VAR_XML_IDENTIFICATION_CITATION": (
            f"<gmd:CI_Citation><gmd:title><gco:CharacterString>{title}</gco:CharacterString></gmd:title>"
            f"<gmd:date>{dated}</gmd:date></gmd:CI_Citation>"
        ),
        "VAR_ABSTRACT": (
            f"Elevations count from {vertical}, positive up. Uncertainty: {VERTICAL_UNCERTAINTY} [m], of the errors of "
            "poses and ranges and the scatter in the cell; without tide, sound speed and the origin's height"
        ),
        "VAR_PROCESS_STEP_DESCRIPTION": f"sonarmap {version('sonarmap')}, {grid.height}: {HEIGHTS[grid.height]}",
    }


def write_depths(path: Path, grid: Georeferenced) -> Mapping[str, Any]:
    """Write a row of COLUMNS per cell that holds points, from northwest to southeast; return the side-car's details."""
    depths = grid.depth_grid
    numbers = (depths.east, depths.north, depths.depth, depths.cells.sigma, depths.cells.count)
    rows = zip(*(column.tolist() for column in numbers), strict=True)
    write_table(path, COLUMNS, ([*(f"{x:z.3f}" for x in lengths), f"{count:.0f}"] for *lengths, count in rows))
    return {
        "easting_m, northing_m": "middle of the cell",
        "depth_m": f"positive down: minus the height, {HEIGHTS[grid.height]}",
        "depth_sigma_m": VERTICAL_UNCERTAINTY,
        **grid.coverage,
    }
