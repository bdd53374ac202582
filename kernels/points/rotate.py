"""A volume rotated about its center."""

import numpy as np
import pyopencl.array as cla

from kernels.errors import InputError
from kernels.opencl.device import Device
from kernels.opencl.launch import affine, launch, output, require_array


def rotate(device: Device, volume: cla.Array, R: np.ndarray, out: cla.Array | None = None) -> cla.Array:
    """out(x) = volume(R^T x), trilinear, about index edge/2 on each axis; 0 where that is off the grid.

    Points of the volume move by R, as `voxelize` moves them with the same R. A sparse volume loses much of
    its fine structure in the interpolation: where the points are at hand, voxelize them again.

    Args:
        volume: (edge, edge, edge) float32, edge even.
        R: (3, 3) rotation.
        out: another array of the same shape, to write to.

    Returns:
        (edge, edge, edge) float32.

    Raises:
        InputError: a shape or dtype is another, R is no rotation, or out is the volume itself.
    """
    edge = volume.shape[0]
    require_array(volume, "volume", (edge, edge, edge))
    if edge % 2:
        raise InputError(f"the volume has {edge} voxels per edge; wanted an even number")
    inverse = affine(np.asarray(R).T)
    if out is volume:
        raise InputError("a volume cannot be rotated in place; give another array as out")
    result = output(device, out, "out", (edge, edge, edge))
    launch(device, "points/rotate", "rotate_volume", (edge, edge), volume, result, inverse, EDGE=edge)
    return result
