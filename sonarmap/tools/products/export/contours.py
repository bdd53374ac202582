# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Lines of equal height through the cells of a map's grid; across cells without points there are none."""

from typing import Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.products.export.georeferenced import Georeferenced

_MOST_CELLS, _MOST_LEVELS = 100_000_000, 10_000  # which are all in memory


def contours_of(earth: Georeferenced) -> list[np.ndarray]:
    """The lines, each (n, 3) easting, northing, height [m], at multiples of `earth.contours`; none without it.

    Raises InputError: too many cells or heights."""
    from contourpy import contour_generator

    if (step := earth.contours) is None:
        return []
    cells, left, top, (rows, columns) = earth.projected_cells()
    low, high = (int(np.ceil(cells.height.min() / step)), int(np.floor(cells.height.max() / step)))
    if rows * columns > _MOST_CELLS or high - low > _MOST_LEVELS:
        raise InputError(
            f"contours every {step:g} m through {rows:,} by {columns:,} cells are too many; give larger cells with "
            "--cell M, or a larger --contours M"
        )
    heights = np.full((rows, columns), np.nan, np.float32)
    heights[cells.row, cells.column] = cells.height
    # from the north-western corner to the cells' middles
    x, y = (left + np.arange(columns) + 0.5) * earth.cell_m, (top - np.arange(rows) - 0.5) * earth.cell_m
    generator: Any = contour_generator(x, y, np.ma.masked_invalid(heights))
    levels = step * np.arange(low, high + 1)
    return [
        np.column_stack([line, np.full(len(line), level)])
        for level in levels.tolist()
        for line in generator.lines(level)
        if len(line) > 1
    ]
