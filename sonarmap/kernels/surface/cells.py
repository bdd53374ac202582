"""Points sorted into cells on the device: nearest-neighbor search, and planes fitted to the neighbors."""

from dataclasses import dataclass

import numpy as np
import pyopencl.array as cla
from pyopencl import cltypes

from sonarmap.kernels.device.arrays import upload_places, upload_poses
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import lanes, launch, require_array, table

_CELL_SIZE = 2.0  # [voxels]; a surface has about a point in a voxel, and most nearest points lie in a cell of four
_CELLS_PER_POINT = 16  # most cells for a point; where there would be more, the cells are larger
_FEWEST_CELLS = 4096  # allowed however few the points are
_TRIM = 0.01  # share of the points at either end of an axis that the cells leave out if they are outliers


@dataclass(frozen=True, slots=True)
class Cells:
    points: cla.Array  # device (m, 4) float32 x, y, z and the bits of the point's number [any length unit]
    starts: cla.Array  # device (cells + 1,) int32, index of each cell's first point
    box: np.void  # origin (3), size and numbers of the cells (3) as a float8 kernel argument

    def __len__(self) -> int:
        return int(self.points.shape[0])

    @property
    def arguments(self) -> tuple[cla.Array, cla.Array, np.void]:
        """The first arguments of `search` in cells.cl."""
        return self.points, self.starts, self.box


@dataclass(frozen=True, slots=True)
class Elements:
    """The points of a surface, on the device that prepared them."""

    rows: cla.Array  # device (m, 12) float32, point, normal and ray of each, in the layout of cells.cl
    cells: Cells  # the same points, to search among

    def __len__(self) -> int:
        return int(self.rows.shape[0])

    def thinned(self, most: int) -> tuple[int, int]:
        """Number of points, and the step between them, of an even choice of at most `most`."""
        step = max(1, -(-len(self) // most))
        return -(-len(self) // step), step


def sort_into_cells(device: Device, points: np.ndarray) -> Cells:
    """Sort points (m, 3), at least one, into cells; coordinates are rounded to float32 [any length unit]."""
    places = np.asarray(points, np.float32)
    origin, side, counts = _box(places)
    cell = np.clip((places - origin) / side, 0, counts - 1).astype(np.int32)
    number = (cell[:, 0] * counts[1] + cell[:, 1]) * counts[2] + cell[:, 2]
    # a merge sort is quick for points that are sorted by voxel already
    order = np.argsort(number, kind="stable").astype(np.int32)
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
    """Origin (3,) float32, size and numbers (3,) int32 of cells around the bulk of the points; sparse points get larger
    cells."""
    size = _CELL_SIZE
    # axis by axis: NumPy takes 20 times as long for short rows
    low, high = (np.array([end(axis) for axis in places.T], np.float64) for end in (np.min, np.max))
    most = max(_CELLS_PER_POINT * len(places), _FEWEST_CELLS)
    if np.prod(np.floor((high - low) / size) + 1) > most:
        ordered, trim = np.sort(places, axis=0), int(_TRIM * len(places))
        inner = ordered[trim].astype(np.float64), ordered[len(places) - 1 - trim].astype(np.float64)
        around = 0.25 * (inner[1] - inner[0]) + size
        low, high = np.maximum(low, inner[0] - around), np.minimum(high, inner[1] + around)
    while np.prod(np.floor((high - low) / size) + 1) > most:
        size *= 1.2
    counts = (np.floor((high - low) / size) + 1).astype(np.int32)
    return low.astype(np.float32), np.float32(size), counts


GROUP = 64  # work-items of a group, which share the cost of its launch


def padded(count: int) -> int:
    """The number of work-items for `count` points: whole groups."""
    return -(-count // GROUP) * GROUP


def find_nearest(
    device: Device, cells: Cells, places: cla.Array, R: np.ndarray, t: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """The nearest point of the cells to each of n places, moved to R place + t, under each of k poses.

    Places are from `upload_places` [the cells' unit]. Returns distances (k, n) float32 and indices (k, n) int32 of the
    points: infinite and -1 where no point is within reach. Of equally near points the first in the cells is taken.
    """
    count, _ = require_array(places, "places", (None, 4))
    poses = upload_poses(device, R, t)
    if not len(R) or not count:
        return np.full((len(R), count), np.inf, np.float32), np.full((len(R), count), -1, np.int32)
    index, squared = device.empty((len(R), count), np.int32), device.empty((len(R), count))
    arguments = *cells.arguments, places, poses, index, squared, np.int32(count), np.float32(reach)
    launch(device, "surface/shared", "nearest", (padded(count), len(R)), *arguments, group=(GROUP, 1))
    return np.sqrt(squared.get()), index.get()


NEIGHBORS = 16  # points of a plane: enough to average noise of a voxel's size, few enough to keep edges


def fit_planes(
    device: Device, cells: Cells, directions: np.ndarray, viewpoints: np.ndarray, *, farthest: float, aside: float
) -> cla.Array:
    """Fit a plane to each point's neighbors by total least squares, and move the point along the normal onto it.

    Args:
        cells: of m points, at least 3.
        directions: (d, 3) unit vectors; the nearest one to each normal is noted.
        viewpoints: (v, 3) sensor positions; the nearest one saw the point. Empty if not known.
        farthest: a point farther than this from its plane is not moved [the points' unit].
        aside: a point is at a rim if the mean of its neighbors is farther away than this share of their spread.

    Returns:
        device (m, 12) float32 in the layout of cells.cl and the points' original order.
    """
    elements = device.empty((len(cells), 12))
    known = table(device, np.column_stack([directions, np.zeros(len(directions))]).astype(np.float32))
    views = upload_places(device, viewpoints if len(viewpoints) else np.zeros((1, 3)))
    numbers = np.int32(len(cells)), np.int32(len(viewpoints)), np.float32(farthest), np.float32(aside)
    arguments = *cells.arguments, known, views, elements, *numbers
    size, group = (padded(len(cells)) // lanes(device),), (GROUP // lanes(device),)
    launch(device, "surface/planes", "planes", size, *arguments, group=group, DIRECTIONS=len(directions))
    return elements
