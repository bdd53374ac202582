# pyright: strict, reportUnknownMemberType=false, reportUnknownVariableType=false, reportMissingTypeStubs=false
# pyright: reportUnknownArgumentType=false
"""Points from above as pixels."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter

from sonarmap.slam.map.point_map import PointMap
from sonarmap.tools.products.report.survey.frame import MapFrame

_WIDER = 1.35  # a dot against the voxel: points lie anywhere in their voxels, and surfaces should show no gaps
_DOT = 2  # least width of a dot [pixels]
_ROUND = ((1.0, 0.4), (0.9, 0.66), (0.78, 0.78), (0.66, 0.9), (0.4, 1.0))  # oblongs that make up a disc [its width]
_COARSE = 5  # dots narrower than this are squares [pixels]
_CELL = 2.0  # edge of the cells in which lone points are looked for, together with the cells around [voxels]
_COMPANY = 2  # points there, itself counted, of a lone point
_SPARSE = 0.1  # share of lone points that makes a map sparse
_EXTREMES = (0.01, 0.99)  # quantiles of heights between which the colors change
_FLAT = 0.5  # least range of the colors [voxels]: less than this is noise


@dataclass(frozen=True, slots=True)
class Cloud:
    """The points of a map that are drawn."""

    flat: np.ndarray  # (M, 2) their places in the picture [m]
    z: np.ndarray  # (M,) their heights in the map's frame [m]
    voxel: float  # of the map [m]
    lone: int  # number of points that are not among them, as they have hardly another near

    @classmethod
    def of(cls, point_map: PointMap, frame: MapFrame) -> "Cloud":
        """Those of a map."""
        specks = lone(point_map.points, point_map.voxel)
        points = point_map.points[~specks]
        return cls(frame.flat(points), points[:, 2], point_map.voxel, int(specks.sum()))


def seen_from_above(
    places: np.ndarray, z: np.ndarray, lower: np.ndarray, shape: tuple[int, int], pixel: float, voxel: float
) -> np.ndarray:
    """(rows, columns) float32: the highest z [m] that is seen at each pixel, the lowest row first; NaN where none is.

    The M points have places (M, 2) in the picture and heights z (M,) [m], and are drawn about as large as a voxel [m];
    what is higher hides what is below it. `lower` (2,) is the lower left corner, `pixel` a pixel's edge [m].
    """
    rows, columns = shape
    column, row = np.floor((places - lower) / pixel).astype(np.int64).T
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    seen = np.full(rows * columns, -np.inf, np.float32)
    np.maximum.at(seen, row[inside] * columns + column[inside], z[inside].astype(np.float32))
    seen = _as_dots(seen.reshape(shape), max(_DOT, round(_WIDER * voxel / pixel)))
    return np.where(np.isfinite(seen), seen, np.nan)


def lone(points: np.ndarray, voxel: float) -> np.ndarray:
    """(M,) bool: which points (M, 3) [m] of a map have hardly another within some voxels.

    Such specks, which are mostly echoes of no surface, would hide what lies below them. None in a map that is so sparse
    that many points are alone.
    """
    cells = np.floor((points - points.min(axis=0)) / (_CELL * voxel)).astype(np.int64) + 1
    strides = np.cumprod([1, *(cells.max(axis=0)[:2] + 2)])
    keys = cells @ strides
    known, which, counts = np.unique(keys, return_inverse=True, return_counts=True)
    few = np.flatnonzero(counts <= _COMPANY)
    around = np.zeros(len(few), np.int64)
    for step in (np.stack(np.meshgrid(*[(-1, 0, 1)] * 3), axis=-1).reshape(-1, 3) @ strides).tolist():
        at = np.minimum(np.searchsorted(known, known[few] + step), len(known) - 1)
        around += np.where(known[at] == known[few] + step, counts[at], 0)
    alone = np.zeros(len(known), bool)
    alone[few[around <= _COMPANY]] = True
    specks = alone[which]
    return specks if specks.mean() <= _SPARSE else np.zeros(len(points), bool)


def _as_dots(seen: np.ndarray, width: int) -> np.ndarray:
    """Every pixel as a disc of this width [pixels]."""
    shapes = ((1.0, 1.0),) if width < _COARSE else _ROUND
    drawn = np.full_like(seen, -np.inf)
    for high, wide in shapes:
        size = max(1, round(high * width)), max(1, round(wide * width))
        np.maximum(drawn, maximum_filter(seen, size, mode="constant", cval=-np.inf), out=drawn)
    return drawn


def color_range(levels: np.ndarray, voxel: float) -> tuple[float, float]:
    """The lowest and the highest of levels (M,) [m] between which the colors change: all but extremes, and never so
    little that a flat bed's noise would look like a relief."""
    low, high = np.quantile(levels, _EXTREMES).tolist()
    lacking = max(0.0, _FLAT * voxel - (high - low)) / 2
    return low - lacking, high + lacking
