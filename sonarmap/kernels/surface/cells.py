"""Points in cells, sorted, on the device: what `cells.cl` finds the nearest of them with."""

from dataclasses import dataclass

import numpy as np
import pyopencl.array as cla
from pyopencl import cltypes

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError

# A surface has about a point a voxel: a cell of so many voxels holds four, and most nearest points lie in it.
_SIZE = 2.0
# So many cells for each point, and so many in any case; where there would be more, they are larger.
_CELLS, _FEWEST = 16, 4096
# The box of the cells leaves out so much of the points at either end of an axis, if they lie far out.
_OUT = 0.01


@dataclass(frozen=True, slots=True)
class Cells:
    points: cla.Array  # device (m, 4) float32 x, y, z and the bits of the point's number [any length unit]
    starts: cla.Array  # device (cells + 1,) int32, where each cell's points begin
    box: np.void  # origin (3), size and numbers of the cells (3) as a float8 kernel argument

    def __len__(self) -> int:
        return int(self.points.shape[0])

    @property
    def arguments(self) -> tuple[cla.Array, cla.Array, np.void]:
        """What `search` of cells.cl takes first."""
        return self.points, self.starts, self.box


@dataclass(frozen=True, slots=True)
class Elements:
    """The points of a surface on the device that they were prepared on."""

    rows: cla.Array  # device (m, 12) float32, point, normal and ray of each as `element.cl` has them
    cells: Cells  # the same points, to search among

    def __len__(self) -> int:
        return int(self.rows.shape[0])

    def thinned(self, most: int) -> tuple[int, int]:
        """At most so many of the points, evenly: their number, and how many points further the next one is."""
        step = max(1, -(-len(self) // most))
        return -(-len(self) // step), step


def sort_into_cells(device: Device, points: np.ndarray) -> Cells:
    """Points (m, 3), at least one, in cells; float32 is what their distances are rounded to [any length unit]."""
    places = np.asarray(points, np.float32)
    if places.ndim != 2 or places.shape[1] != 3 or not len(places) or not np.isfinite(places).all():
        raise InputError(f"`points` have shape {points.shape}; wanted (m, 3), at least one, all of it finite numbers")
    origin, side, counts = _box(places)
    cell = np.clip((places - origin) / side, 0, counts - 1).astype(np.int32)
    number = (cell[:, 0] * counts[1] + cell[:, 1]) * counts[2] + cell[:, 2]
    # one number to sort by, the place behind the cell
    order = np.sort((number.astype(np.int64) << 32) | np.arange(len(number))).astype(np.int32)
    starts = np.zeros(int(counts.prod()) + 1, np.int32)
    np.cumsum(np.bincount(number, minlength=len(starts) - 1), out=starts[1:])
    rows = np.empty((len(places), 4), np.float32)
    rows[:, :3], rows[:, 3] = places[order], order.view(np.float32)
    return Cells(
        device.to_device(rows),
        device.to_device(starts),
        # pyrefly: ignore[missing-attribute]
        cltypes.make_float8(*origin, side, *counts, 0),
    )


def _box(places: np.ndarray) -> tuple[np.ndarray, np.float32, np.ndarray]:
    """Origin (3,) float32, size and numbers (3,) int32 of cells that hold the bulk of the points; larger ones where
    these are sparse."""
    size = _SIZE
    # axis by axis: NumPy takes 20 times as long for short rows
    low, high = (np.array([end(axis) for axis in places.T], np.float64) for end in (np.min, np.max))
    most = max(_CELLS * len(places), _FEWEST)
    if np.prod(np.floor((high - low) / size) + 1) > most:
        ordered, out = np.sort(places, axis=0), int(_OUT * len(places))
        inner = ordered[out].astype(np.float64), ordered[len(places) - 1 - out].astype(np.float64)
        around = 0.25 * (inner[1] - inner[0]) + size
        low, high = np.maximum(low, inner[0] - around), np.minimum(high, inner[1] + around)
    while np.prod(np.floor((high - low) / size) + 1) > most:
        size *= 1.2
    counts = (np.floor((high - low) / size) + 1).astype(np.int32)
    return low.astype(np.float32), np.float32(size), counts
