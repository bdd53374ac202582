# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""The map from above as pictures whose rows and columns follow latitude and longitude, and their legend."""

from dataclasses import dataclass
from io import BytesIO

import numpy as np

from sonarmap.tools.files.geo.georeference import VERTICALS
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.grid import HEIGHT_COLORS

_LARGEST, _SMALLEST = 4096, 1024  # edge of a picture: beyond it graphics cards shrink it, below it edges are blurred
_DEGREE = 111_195.0  # of latitude on the mean sphere [m]; a pixel's size need not be exact


@dataclass(frozen=True, slots=True)
class Picture:
    """A PNG on the Earth."""

    png: bytes  # the file
    box: dict[str, float]  # north, south, east, west [deg]; west is less than east


def pictures_of(earth: Georeferenced) -> list[Picture]:
    """The map from above, colored by height, clear where there are no points: one picture, two across 180 degrees.

    A pixel shows the same height as a cell of the GeoTIFF would there.
    """
    from matplotlib import colormaps

    latitude, longitude, _ = earth.points.T
    middle = earth.georeference.longitude
    longitude = middle + (longitude - middle + 180) % 360 - 180  # without the jump at 180 degrees
    across = _DEGREE * np.cos(np.radians(np.abs(latitude).min()))
    extents = np.ptp(latitude) * _DEGREE, np.ptp(longitude) * across
    cell = max(earth.cell_m, *(extent / _LARGEST for extent in extents))
    # columns that go round the Earth evenly, so that 180 degrees is the edge of a column
    around, down = round(360 * across / cell), cell / _DEGREE
    row = np.floor((90 - latitude) / down).astype(np.int64)
    column = np.floor((longitude + 180) / 360 * around).astype(np.int64)
    low, high = earth.shown_heights
    pictures: list[Picture] = []
    for turn in np.unique(column // around).tolist():
        here = column // around == turn
        upper, left = int(row[here].min()), int(column[here].min())
        cells = earth.cells(row[here] - upper, column[here] - left, here)
        rows, width = int(cells.row.max()) + 1, int(cells.column.max()) + 1
        colors = np.zeros((rows, width, 4), np.uint8)
        shares = np.clip((cells.height - low) / (high - low), 0, 1)
        colors[cells.row, cells.column] = colormaps[HEIGHT_COLORS](shares, bytes=True)
        box = {"north": 90 - upper * down, "south": 90 - (upper + rows) * down}
        for side, edge in (("east", left + width), ("west", left)):
            box[side] = -180 + 360 * (edge - turn * around) / around
        pictures.append(Picture(_png(colors), box))
    return pictures


def legend_of(earth: Georeferenced) -> bytes:
    """A PNG that says which color is which height."""
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
