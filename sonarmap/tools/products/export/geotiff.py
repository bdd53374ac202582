"""GeoTIFF: the map from above, north up in projected coordinates, or in the map's own frame."""

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.map.surface import surface_reach
from sonarmap.tools.files.geo.georeference import VERTICALS
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.formats import HEIGHTS
from sonarmap.tools.products.export.georeferenced import Georeferenced, MapGrid
from sonarmap.tools.products.export.grid import HEIGHT_COLORS, Cells, empty_share, sufficient_cell
from sonarmap.tools.products.export.kmz import xml_bytes

NODATA = -9999.0
_BLOCK = 256  # edge of a tile
_BANDS = ("height", "sigma", "count")
_STEPS = 17  # of the colors in QGIS, which blends between them
_PROFILE: dict[str, Any] = {
    "driver": "GTiff",
    "dtype": "float32",
    "count": len(_BANDS),
    "nodata": NODATA,
    "tiled": True,
    "blockxsize": _BLOCK,
    "blockysize": _BLOCK,
    "compress": "deflate",
    "predictor": 3,  # of floating-point numbers
    "bigtiff": "if_safer",
    "sparse_ok": True,
}


def write_geotiff(path: Path, grid: MapGrid) -> Mapping[str, Any]:
    """Write the heights that `grid.height` names (band 1), standard deviations (2), and how many sonar points (3).

    Cells are `grid.cell_m` wide; their edges lie at multiples of that, so that grids of two maps fit each other. A cell
    without points has no value: nothing is interpolated. Beside it stands the style that QGIS shows it in. Returns what
    the bands mean."""
    import rasterio

    cell = grid.cell_m
    cells, left, top, (rows, columns) = grid.projected_cells()
    # without the heights' CRS, which the tags name: many programs look a plain code up, and GDAL loses one of 3D
    on_earth = isinstance(grid, Georeferenced)
    crs = rasterio.CRS.from_wkt(grid.projection.crs.to_wkt()) if on_earth else None
    place = {"crs": crs, "transform": rasterio.Affine(cell, 0, left * cell, 0, -cell, top * cell)}
    places, reach = grid.projected_points[:, :2], surface_reach(grid.surface.points, grid.folder.voxel)
    with atomic_path(path) as temporary:
        with rasterio.open(temporary, "w", height=rows, width=columns, **place, **_PROFILE) as raster:
            _describe(raster, grid)
            _fill(raster, cells, rows, columns)
        _require_whole(temporary, path)
    with atomic_path(path.with_suffix(".qml")) as temporary:
        temporary.write_bytes(_qgis_style(grid))
    return {
        "band_1": f"height [m], positive up: {HEIGHTS[grid.height]}",
        "band_2": "standard deviation of the height [m]",
        "band_3": "number of sonar points that the height is from, or of those in the cell if it is one of them",
        "cell_m": cell,
        "empty_share": empty_share(places, cell, reach),
        "sufficient_cell_m": sufficient_cell(places, cell, reach),
        "nodata": NODATA,
        "pixels": "areas: a cell's value holds for all of it; cells without points are empty",
    }


def _describe(raster: Any, grid: MapGrid) -> None:
    vertical, epsg = "the zero of the map's frame", None
    if isinstance(grid, Georeferenced):
        vertical, epsg = VERTICALS[grid.georeference.vertical], grid.projection.vertical_epsg
    raster.update_tags(
        AREA_OR_POINT="Area",
        TIFFTAG_SOFTWARE=f"sonarmap {version('sonarmap')}",
        VERTICAL_REFERENCE=f"heights count from {vertical}{f' (EPSG:{epsg})' if epsg else ''}",
        HEIGHT=f"{grid.height}: {HEIGHTS[grid.height]}",
        SIGN="heights are positive up; a depth is minus the height",
    )
    raster.descriptions = (f"height above {vertical}", "standard deviation of the height", "number of sonar points")
    raster.units = ("m", "m", "points")


def _fill(raster: Any, cells: Cells, rows: int, columns: int) -> None:
    """Write the tiles that hold points, a row of tiles at a time; what is not written reads as no value."""
    from rasterio.windows import Window

    starts = np.searchsorted(cells.row, np.arange(0, rows + _BLOCK, _BLOCK))
    for first, last in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
        tile = cells.column[first:last] // _BLOCK
        for number in np.unique(tile).tolist():
            here = np.arange(first, last)[tile == number]
            upper, left = int(cells.row[first]) // _BLOCK * _BLOCK, number * _BLOCK
            shape = min(_BLOCK, rows - upper), min(_BLOCK, columns - left)
            values = np.full((len(_BANDS), *shape), NODATA, np.float32)
            values[:, cells.row[here] - upper, cells.column[here] - left] = [
                getattr(cells, band)[here] for band in _BANDS
            ]
            raster.write(values, window=Window.from_slices((upper, upper + shape[0]), (left, left + shape[1])))


def _require_whole(temporary: Path, path: Path) -> None:
    """Read the raster once: GDAL writes its last tiles when it closes a file, and does not say if the disk is full."""
    import rasterio
    from rasterio.errors import RasterioError

    try:
        with rasterio.open(temporary) as raster:
            for _, window in raster.block_windows(1):
                raster.read(window=window)
    except RasterioError as error:
        raise InputError(f"cannot write {path}: {error}. Make room, or choose another folder") from error


def _qgis_style(grid: MapGrid) -> bytes:
    """Band 1 in the colors of the KMZ's picture: left alone, QGIS mixes the three bands to red, green and blue.

    QGIS reads the file of the same name when it opens the raster. Nothing else may have that name: a KML layer beside a
    style for rasters loses its own colors.
    """
    from matplotlib import colormaps, colors

    low, high = grid.shown_heights
    heights = {share: low + share * (high - low) for share in np.linspace(0, 1, _STEPS).tolist()}
    items = [
        {"@value": f"{height:.4f}", "@label": f"{height:.2f} m"}
        | {"@color": colors.to_hex(colormaps[HEIGHT_COLORS](share)), "@alpha": "255"}
        for share, height in heights.items()
    ]
    ramp = {"@colorRampType": "INTERPOLATED", "@classificationMode": "2", "@clip": "0"}
    ramp |= {"@minimumValue": f"{low:.4f}", "@maximumValue": f"{high:.4f}"}
    band = {"@type": "singlebandpseudocolor", "@band": "1", "@opacity": "1", "@alphaBand": "-1"}
    band |= {"@classificationMin": f"{low:.4f}", "@classificationMax": f"{high:.4f}"}
    renderer = {**band, "rastershader": {"colorrampshader": {**ramp, "item": items}}}
    style = {"@version": "3.22.0", "@styleCategories": "Symbology"}
    return xml_bytes("qgis", {**style, "pipe": {"rasterrenderer": renderer}})
