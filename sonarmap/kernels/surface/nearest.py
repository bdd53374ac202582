"""The nearest points of a surface to many points under many poses."""

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import launch, require_array
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.points.poses import upload_places, upload_poses
from sonarmap.kernels.surface.cells import Cells

__all__ = ["find_nearest", "upload_places"]

GROUP = 64  # work-items that share what a launch of a group costs


def padded(count: int) -> int:
    """The number of work-items for so many points: whole groups."""
    return -(-count // GROUP) * GROUP


def find_nearest(
    device: Device, cells: Cells, places: cla.Array, R: np.ndarray, t: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """The nearest point of the cells to each place, moved by each pose.

    Args:
        places: device (n, 4) float32, from `upload_places` [the cells' unit].
        R, t: (k, 3, 3) and (k, 3), p = R place + t in the cells' frame.
        reach: the farthest that a nearest point may lie.

    Returns:
        Distances (k, n) float32, infinite where nothing is within reach, and numbers (k, n) int32 of the points, -1
        there; of points equally far the first.
    """
    count, _ = require_array(places, "places", (None, 4))
    poses = upload_poses(device, R, t)
    if not reach >= 0:
        raise InputError(f"`reach={reach}`; wanted 0 or more")
    if not len(R) or not count:
        return np.full((len(R), count), np.inf, np.float32), np.full((len(R), count), -1, np.int32)
    index, squared = device.empty((len(R), count), np.int32), device.empty((len(R), count))
    arguments = *cells.arguments, places, poses, index, squared, np.int32(count), np.float32(reach)
    launch(device, "surface/nearest", "nearest", (padded(count), len(R)), *arguments, group=(GROUP, 1))
    return np.sqrt(squared.get()), index.get()
