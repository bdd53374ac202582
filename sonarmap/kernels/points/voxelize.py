"""Voxelize points: each voxel holds the largest weight of its points. Scale points to a grid of other voxels."""

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import affine, launch, output, require_array, zero
from sonarmap.kernels.errors import InputError


def voxelize(
    device: Device,
    points: cla.Array,
    edge: int,
    R: np.ndarray | None = None,
    offset: np.ndarray | None = None,
    out: cla.Array | None = None,
) -> cla.Array:
    """The volume of points that are first moved by R and the offset (Sect. 2.1 of the paper for weight 1).

    A point p goes to the voxel floor(R p + offset + edge/2 + 0.5); points outside are dropped.

    Args:
        points: (n, 4) float32: x, y, z relative to the grid's center [voxels], then a weight: 1 for the
            paper's occupancy, or the echo strength. Points with a weight of 0 or less are dropped.
        R: (3, 3) rotation of the points; None for none.
        offset: (3,) shift after the rotation [voxels]; None for none.

    Returns:
        (edge, edge, edge) float32, 0 where there is no point; independent of the order of the points.
    """
    if edge < 2 or edge % 2:
        raise InputError(f"`edge={edge}` voxels; wanted an even number")
    count, _ = require_array(points, "points", (None, 4))
    shift = np.zeros(3) if offset is None else np.asarray(offset, np.float64)
    pose = affine(R, shift + (edge / 2 + 0.5))
    volume = output(device, out, "out", (edge, edge, edge))
    zero(device, volume)
    if count:
        arguments = points, volume, np.int32(count), np.int32(edge), pose
        launch(device, "points/voxelize", "voxelize", (count, 1), *arguments, group="points")
    return volume


def voxelize_poses(
    device: Device, points: cla.Array, volumes: cla.Array, marks: cla.Array, poses: cla.Array, first: int, count: int
) -> None:
    """Voxelize the points under `count` poses at once, as `voxelize` does, into volumes that are empty.

    Args:
        points: (n, 4) float32, as in `voxelize`.
        volumes: (at least count, edge, edge, edge) float32, 0 everywhere.
        marks: (as many, edge^2 / 8, rounded up) int32: set to 1 for each 8 rows that hold a point.
        poses: (m, 20) float32, m at least first + count: `affine_rows` of R and the offset + edge/2 + 0.5; 4 unused.
        first: the first volume's pose.
    """
    points_count, _ = require_array(points, "points", (None, 4))
    most, edge, _, _ = require_array(volumes, "volumes", (None, None, None, None))
    require_array(marks, "marks", (most, -(-(edge**2) // 8)), np.int32)
    require_array(poses, "poses", (None, 20))
    if points_count:
        arguments = points, volumes, marks, poses, np.int32(points_count), np.int32(edge), np.int32(first)
        launch(device, "points/voxelize", "voxelize_poses", (points_count, count), *arguments, group="points")


def scaled(device: Device, points: cla.Array, factor: float) -> cla.Array:
    """Points (n, 4) float32 with x, y, z times `factor`, for voxels 1 / factor times as large; weights stay."""
    count, _ = require_array(points, "points", (None, 4))
    result = device.empty((count, 4))
    if count:
        arguments = points, result, np.int32(count), np.float32(factor)
        launch(device, "points/voxelize", "scaled", (count, 1), *arguments, group="points")
    return result
