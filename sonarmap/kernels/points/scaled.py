"""Points on a grid of other voxels."""

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import launch, require_array

_GROUP = 256


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
        size, group = (-(-count // _GROUP) * _GROUP,), (_GROUP,)
        launch(
            device, "points/scaled", "scaled", size, points, result, np.int32(count), np.float32(factor), group=group
        )
    return result
