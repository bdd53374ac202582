# pyright: strict
"""Points to a volume: each voxel holds the largest weight of its points."""

import numpy as np
import pyopencl.array as cla

from kernels.device.device import Device
from kernels.device.launch import affine, launch, output, require_array, zero
from kernels.errors import InputError

_GROUP = 256


def voxelize(
    device: Device,
    points: cla.Array,
    edge: int,
    R: np.ndarray | None = None,
    offset: np.ndarray | None = None,
    out: cla.Array | None = None,
) -> cla.Array:
    """The volume of points, moved by R and the offset on their way (Sect. 2.1 of the paper for weight 1).

    A point p goes to the voxel floor(R p + offset + edge/2 + 0.5); points outside are dropped.

    Args:
        points: (n, 4) float32: x, y, z relative to the grid's center [voxels], then a weight: 1 for the
            paper's occupancy, or the echo strength. Points with a weight of 0 or less are dropped.
        edge: voxels along each axis.
        R: (3, 3) rotation of the points; None for none.
        offset: (3,) shift after the rotation [voxels]; None for none.
        out: (edge, edge, edge) float32 to write to.

    Returns:
        (edge, edge, edge) float32, 0 where there is no point; independent of the order of the points.

    Raises:
        InputError: the points, R, the offset or out have another shape or dtype.
    """
    if edge < 2 or edge % 2:
        raise InputError(f"`edge={edge}` voxels; wanted an even number, best a power of two")
    count, _ = require_array(points, "points", (None, 4))
    shift = np.zeros(3) if offset is None else np.asarray(offset, np.float64)
    pose = affine(R, shift + (edge / 2 + 0.5))
    volume = output(device, out, "out", (edge, edge, edge))
    zero(device, volume)
    if count:
        size, group = (-(-count // _GROUP) * _GROUP,), (_GROUP,)
        arguments = points, volume, np.int32(count), pose
        launch(device, "points/voxelize", "voxelize", size, *arguments, group=group, EDGE=edge)
    return volume
