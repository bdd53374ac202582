"""The planes that the neighbors of a surface's points show, and the points moved onto them."""

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.groups import lanes
from sonarmap.kernels.device.launch import launch, table
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.points.poses import require_places, upload_places
from sonarmap.kernels.surface.cells import Cells
from sonarmap.kernels.surface.nearest import GROUP, padded

# So many neighbors make a plane: enough to average noise of a voxel's size, few enough to keep edges.
NEIGHBORS = 16


def fit_planes(
    device: Device, cells: Cells, directions: np.ndarray, viewpoints: np.ndarray, *, farthest: float, aside: float
) -> cla.Array:
    """The points of the cells moved along the normal onto the plane of their neighbors, by total least squares.

    Args:
        cells: of m points, at least 3.
        directions: (d, 3) unit vectors.
        viewpoints: (v, 3) where the points were seen from [the points' unit]: each from the nearest; none: not known.
        farthest: a point farther than this from its plane stays [the points' unit].
        aside: a point whose neighbors' middle is farther away than this share of their spread is at a rim.

    Returns:
        device (m, 12) float32 as `element.cl` has it, in the points' own order.
    """
    if len(cells) < 3:
        raise InputError(f"{len(cells)} points show no plane; wanted at least 3")
    require_places(directions, "directions")
    require_places(viewpoints, "viewpoints")
    elements = device.empty((len(cells), 12))
    known = table(device, np.column_stack([directions, np.zeros(len(directions))]).astype(np.float32))
    views = upload_places(device, viewpoints if len(viewpoints) else np.zeros((1, 3)))
    numbers = np.int32(len(cells)), np.int32(len(viewpoints)), np.float32(farthest), np.float32(aside)
    arguments = *cells.arguments, known, views, elements, *numbers
    size, group = (padded(len(cells)) // lanes(device),), (GROUP // lanes(device),)
    launch(device, "surface/planes", "planes", size, *arguments, group=group, DIRECTIONS=len(directions))
    return elements
