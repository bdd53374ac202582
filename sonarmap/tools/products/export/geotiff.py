"""GeoTIFF: the map from above, north up in projected coordinates, or in the map's frame. KMZ for Google Earth and
similar programs: a map's track, its start and end, and a picture on the ground.

A KMZ is clamped to the ground, at sea the water's surface: Google Earth's sea floor is coarse and would hide a map at
its true height. The coordinates contain the heights nevertheless.
"""

import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import DEGREE, VERTICALS
from sonarmap.tools.files.time_scales import utc_text
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.formats import HEIGHTS
from sonarmap.tools.products.export.georeferenced import Georeferenced, MapGrid
from sonarmap.tools.products.export.grid import HEIGHT_COLORS, DepthGrid

NODATA = -9999.0
_BLOCK = 256  # edge of a tile
_BANDS = ("height", "sigma", "count")  # of `Cells`
VERTICAL_UNCERTAINTY = "vertical uncertainty, one standard deviation"
_STEPS = 17  # number of colors in QGIS, which interpolates between them
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
    """Write heights of the kind `grid.height` (band 1), standard deviations (2) and numbers of sonar points (3), and a
    style for QGIS beside the file; return the side-car's details.

    Edges of cells lie at multiples of `grid.cell_m`, so that grids of two maps fit. Cells without points are empty."""
    import rasterio

    # The vertical CRS is in the tags alone: many programs expect the code of a 2D CRS, and GDAL loses that of a 3D one
    on_earth = isinstance(grid, Georeferenced)
    crs = grid.projection.crs.to_wkt() if on_earth else None
    with atomic_path(path) as temporary, gdal_writes(path):
        with rasterio.open(temporary, "w", crs=crs, **layout(grid.depth_grid), **_PROFILE) as raster:
            _describe(raster, grid)
            fill(raster, grid.depth_grid, _BANDS)
        read_whole(temporary)
    with atomic_path(path.with_suffix(".qml")) as temporary:
        temporary.write_bytes(_qgis_style(grid))
    return {
        "band_1": f"height [m], positive up: {HEIGHTS[grid.height]}",
        "band_2": "vertical uncertainty: one standard deviation of the height [m]",
        "band_3": "number of sonar points behind the height, or of all in the cell if the height is that of one point",
        **grid.coverage,
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
    raster.descriptions = (f"height above {vertical}", VERTICAL_UNCERTAINTY, "number of sonar points")
    raster.units = ("m", "m", "points")


def layout(grid: DepthGrid) -> dict[str, Any]:
    """Rasterio's options for the size and the place of a grid."""
    from rasterio import Affine

    (rows, columns), cell = grid.shape, grid.cell_m
    return {
        "height": rows,
        "width": columns,
        "transform": Affine(cell, 0, grid.left * cell, 0, -cell, grid.top * cell),
    }


def fill(raster: Any, grid: DepthGrid, bands: Sequence[str]) -> None:
    """Write the tiles that hold points, one row of tiles at a time; missing tiles read as the raster's nodata. `bands`
    are names of columns of `Cells`."""
    from rasterio.windows import Window

    cells, (rows, columns) = grid.cells, grid.shape
    starts = np.searchsorted(cells.row, np.arange(0, rows + _BLOCK, _BLOCK))
    for first, last in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
        tile = cells.column[first:last] // _BLOCK
        for number in np.unique(tile).tolist():
            here = np.arange(first, last)[tile == number]
            upper, left = int(cells.row[first]) // _BLOCK * _BLOCK, number * _BLOCK
            shape = min(_BLOCK, rows - upper), min(_BLOCK, columns - left)
            values = np.full((len(bands), *shape), raster.nodata, np.float32)
            values[:, cells.row[here] - upper, cells.column[here] - left] = [
                getattr(cells, band)[here] for band in bands
            ]
            raster.write(values, window=Window.from_slices((upper, upper + shape[0]), (left, left + shape[1])))


def read_whole(temporary: Path) -> None:
    """Read the raster once: GDAL writes its last tiles on closing a file, and does not report a full disk."""
    import rasterio

    with rasterio.open(temporary) as raster:
        for _, window in raster.block_windows(1):
            raster.read(window=window)


@contextmanager
def gdal_writes(path: Path) -> Iterator[None]:
    """Turn an error of GDAL in the block into an InputError that says what to do if `path` cannot be written."""
    from rasterio.errors import RasterioError

    try:
        yield
    except RasterioError as error:
        raise InputError(f"cannot write {path}: {error}; free disk space, or choose another folder") from error


def _qgis_style(grid: MapGrid) -> bytes:
    """Style that shows band 1 in the colors of the KMZ's picture; by default QGIS mixes the three bands to RGB.

    QGIS applies the style to every layer of the same name; a KML layer of that name would lose its colors."""
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


KML = "http://www.opengis.net/kml/2.2"
_CLAMPED = {"altitudeMode": "clampToGround"}
_TRACK_COLOR = "ff2727d6"  # alpha, blue, green, red
_NOT_IN_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_MAP, _LEGEND = "files/map.png", "files/legend.png"  # in a KMZ
_LEGEND_PLACE = {  # in the lower left corner of the screen, in its own size
    name: {"@x": x, "@y": y, "@xunits": "fraction", "@yunits": "fraction"}
    for name, x, y in (("overlayXY", "0", "0"), ("screenXY", "0.02", "0.06"), ("size", "-1", "-1"))
}
_LARGEST, _SMALLEST = 4096, 1024  # edge of a picture [px]: graphics cards shrink larger ones and blur smaller ones


@dataclass(frozen=True, slots=True)
class Picture:
    """A georeferenced PNG."""

    png: bytes
    box: dict[str, float]  # north, south, east, west [deg]


def write_kmz(path: Path, earth: Georeferenced) -> Mapping[str, Any]:
    """Write the track of a part, the map from above as a picture on the ground, and a legend, as KML 2.2 in a zip
    archive; return the side-car's details."""
    picture = picture_of(earth)
    contents = [("doc.kml", _document(earth, picture)), (_MAP, picture.png), (_LEGEND, legend_of(earth))]
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, content in contents:  # readers expect the document first
            entry = zipfile.ZipInfo(name)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)
    return {
        "picture": "the uppermost surface from above, colored by height from the first to the last percent of the "
        "points that several scans saw; north up, rows and columns along latitude and longitude",
        "altitude_mode": "clampToGround: all is drawn on the water's surface, whatever its height",
    }


def _document(earth: Georeferenced, picture: Picture) -> bytes:
    """The KML document in UTF-8."""
    part, track = earth.part, {"tessellate": "1", **_CLAMPED}
    track["coordinates"] = "\n".join(_coordinate(place, ",") for place in earth.poses)
    ends = [_place(earth, "start", 0), _place(earth, "end", -1)]
    line = {"name": "track", "styleUrl": "#track", "LineString": track}
    document = {
        "name": f"{earth.folder.path.resolve().name} map{part.suffix}",
        "open": "1",
        "description": _described(
            f"{len(part.scans)} scans, {len(part.points):,} points, voxel {earth.folder.voxel:.3g} m. Heights count "
            f"from {VERTICALS[earth.georeference.vertical]}, positive up. Everything is drawn on the water's surface."
        ),
        "Style": {"@id": "track", "LineStyle": {"color": _TRACK_COLOR, "width": "3"}},
        "GroundOverlay": _overlay(picture),
        "ScreenOverlay": {"name": "heights", "Icon": {"href": _LEGEND}, **_LEGEND_PLACE},
        "Placemark": [line, *ends],
    }
    return xml_bytes("kml", {"@xmlns": KML, "Document": document})


def xml_bytes(tag: str, content: Mapping[str, Any]) -> bytes:
    """An XML document in UTF-8. Keys of `content` are attributes (@name) or children, whose values are texts, mappings,
    or lists of these. Characters that XML cannot hold, as in file names, become question marks."""
    root = Element(tag)
    _fill_element(root, content)
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text


def _fill_element(element: Element, content: Mapping[str, Any]) -> None:
    for name, value in content.items():
        if name.startswith("@"):
            element.set(name[1:], value)
            continue
        for inner in value if isinstance(value, list) else [value]:
            child = SubElement(element, name)
            if isinstance(inner, str):
                child.text = _NOT_IN_XML.sub("?", inner)
            else:
                _fill_element(child, inner)


def _described(words: str) -> str:
    """A description with HTML escaped, as Google Earth shows descriptions as HTML."""
    return escape(words, quote=False)


def _overlay(picture: Picture) -> dict[str, Any]:
    box = {side: f"{degrees:.10f}" for side, degrees in picture.box.items()}
    return {"name": "map", "Icon": {"href": _MAP}, **_CLAMPED, "LatLonBox": box}


def _place(earth: Georeferenced, name: str, k: int) -> dict[str, Any]:
    place, stamp = earth.poses[k], float(earth.stamps[k])
    time = utc_text(stamp) if earth.timed else f"stamp {stamp:g} s"
    words = f"{earth.names[k]}, {time}, {place[0]:.8f}, {place[1]:.8f}, height {place[2]:.2f} m"
    point = {**_CLAMPED, "coordinates": _coordinate(place, ",")}
    return {"name": name, "description": _described(words), "Point": point}


def _coordinate(place: np.ndarray, separator: str) -> str:
    """Longitude, latitude [deg] and height [m] of a place (3,), to a tenth of a millimeter."""
    latitude, longitude, height = place.tolist()
    return separator.join((f"{longitude:.10f}", f"{latitude:.10f}", f"{height:.4f}"))


def picture_of(earth: Georeferenced) -> Picture:
    """The map from above, colored by height, transparent where there are no points. Pixels have the heights of the
    GeoTIFF's cells; longitudes beyond 180 degrees continue."""
    from matplotlib import colormaps

    latitude, longitude, _ = earth.points.T
    middle = earth.georeference.longitude
    longitude = middle + (longitude - middle + 180) % 360 - 180  # without the jump at 180 degrees
    degree = DEGREE * np.cos(np.radians(np.abs(latitude).min()))  # of longitude [m]
    extents = np.ptp(latitude) * DEGREE, np.ptp(longitude) * degree
    cell = max(earth.cell_m, *(extent / _LARGEST for extent in extents))
    across, down = cell / degree, cell / DEGREE
    row = np.floor((90 - latitude) / down).astype(np.int64)
    column = np.floor((longitude + 360) / across).astype(np.int64)
    upper, left = int(row.min()), int(column.min())
    cells = earth.cells(row - upper, column - left)
    rows, columns = int(cells.row.max()) + 1, int(cells.column.max()) + 1
    low, high = earth.shown_heights
    colors = np.zeros((rows, columns, 4), np.uint8)
    shares = np.clip((cells.height - low) / (high - low), 0, 1)
    colors[cells.row, cells.column] = colormaps[HEIGHT_COLORS](shares, bytes=True)
    box = {"north": 90 - upper * down, "south": 90 - (upper + rows) * down}
    box |= {"east": (left + columns) * across - 360, "west": left * across - 360}
    return Picture(_png(colors), box)


def legend_of(earth: Georeferenced) -> bytes:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    low, high = earth.shown_heights
    figure = Figure(figsize=(1.4, 3.2), dpi=110, facecolor=(1, 1, 1, 0.85))
    axes = figure.add_axes((0.1, 0.05, 0.18, 0.9))
    scale = figure.colorbar(ScalarMappable(Normalize(low, high), HEIGHT_COLORS), cax=axes)
    scale.set_label(f"height [m] above\n{VERTICALS[earth.georeference.vertical]}", fontsize=8)
    scale.ax.tick_params(labelsize=8)
    drawn = BytesIO()
    figure.savefig(drawn, format="png")
    return drawn.getvalue()


def _png(colors: np.ndarray) -> bytes:
    from PIL import Image

    times = max(1, _SMALLEST // max(colors.shape[:2]))
    drawn = BytesIO()
    Image.fromarray(colors.repeat(times, axis=0).repeat(times, axis=1)).save(drawn, format="png", optimize=True)
    return drawn.getvalue()
