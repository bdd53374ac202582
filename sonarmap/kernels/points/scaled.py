"""Points on a grid of other voxels."""

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import launch, require_array


def scaled(device: Device, points: cla.Array, factor: float) -> cla.Array:
    """The points on a grid whose voxels are 1 / factor times as large.

    Args:
        points: (n, 4) float32: x, y, z relative to the grid's center [voxels], then a weight, which stays.

    Returns:
        (n, 4) float32.

    Raises:
        InputError: the points have another shape or dtype.
    """
    count, _ = require_array(points, "points", (None, 4))
    result = device.empty((count, 4))
    if count:
        arguments = points, result, np.int32(count), np.float32(factor)
        launch(device, "points/scaled", "scaled", (count, 1), *arguments, group="points")
    return result
