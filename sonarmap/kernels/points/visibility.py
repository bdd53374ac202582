"""Agreement of points with range images under many poses: points agree, or lie where a beam passed through."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import cast

import numpy as np
import pyopencl.array as cla
from pyopencl import cltypes

from sonarmap.kernels.device.arrays import Pending, Readback, upload_places
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import launch, require_array

_LANES = 8  # the number of points is padded to a multiple of this
_GROUP = 64  # work-items of a group on a GPU


def octahedral_cells(directions: np.ndarray, edge: int) -> np.ndarray:
    """Cells (n,) int64, of an octahedral map of edge x edge in C order, of directions (n, 3) of any length.

    The octahedron |x| + |y| + |z| = 1 is unfolded to a square (Engelhardt and Dachsbacher, "Octahedron environment
    maps", VMV 2008): it has no poles, and its cells' sizes differ by up to a factor of 5.2. A zero vector counts as +z.
    """
    x, y, z = np.ascontiguousarray(directions.T)  # column by column, which is faster than row by row
    length = np.maximum(np.abs(x) + np.abs(y) + np.abs(z), 1e-20)
    u, v, below = x / length, y / length, np.flatnonzero(z < 0)
    folded_u, folded_v = 1 - np.abs(v[below]), 1 - np.abs(u[below])
    u[below], v[below] = np.where(u[below] < 0, -folded_u, folded_u), np.where(v[below] < 0, -folded_v, folded_v)
    i, j = (np.clip(((side + 1) * (0.5 * edge)).astype(np.int64), 0, edge - 1) for side in (u, v))
    return i * edge + j


def upload_points(device: Device, points: np.ndarray) -> tuple[cla.Array, int]:
    """Upload points (n, 3) for `agreement`: (3, n padded to a multiple of 8) float32, and n."""
    padded = np.zeros((3, -(-max(len(points), 1) // _LANES) * _LANES), np.float32)
    padded[:, : len(points)] = points.T
    return device.to_device(padded), len(points)


def upload_viewpoints(device: Device, places: np.ndarray) -> cla.Array:
    """Upload the sensor positions (k, 3) of k range images for `agreement`: (k, 4) float32."""
    return upload_places(device, places)


@dataclass(frozen=True, slots=True)
class Viewing:
    """Points of one scan, and the range images of another that they are compared with."""

    # device (k, edge, edge, 2) float32, nearest and farthest range of every cell of an octahedral map, (inf, -inf)
    # without a range; None without images
    views: cla.Array | None
    # from `upload_viewpoints`, in the frame of the images' scan [any length unit]; None without images
    viewpoints: cla.Array | None
    points: tuple[cla.Array, int]  # from `upload_points`, in their scan's frame [the same unit]


def agreement(
    device: Device, viewings: Sequence[Viewing], poses: cla.Array, tolerances: Sequence[tuple[float, float]]
) -> Pending[list[np.ndarray]]:
    """Queue the counts of points, moved by each pose, that agree with range images or contradict them, in one launch.

    Args:
        viewings: one, or two with images of the same edge.
        poses: device (n, 16) float32 from `upload_poses`; they move the first viewing's points to the frame of its
            images, and their inverses move the second's.
        tolerances: one or two of (reach, slope), not negative: a point within reach + slope * range of its cell's
            ranges agrees; a nearer one contradicts them, and a farther one is hidden.

    Returns:
        (k, n, tolerances, 3) int64 for each viewing: points that agree, that contradict, and that fall into cells with
        a range.
    """
    images = [0 if viewing.views is None else len(viewing.views) for viewing in viewings]
    n, _ = require_array(poses, "poses", (None, 16))
    counts = device.empty((sum(images), n, len(tolerances), 3), np.int32)
    seeing = [viewing for viewing in viewings if viewing.views is not None]
    if counts.size:
        both = viewings[0], viewings[-1]
        # a viewing without images has no job, but needs arguments
        shown = [seeing[0] if viewing.views is None else viewing for viewing in both]
        arrays = [cast(cla.Array, array) for viewing in shown for array in (viewing.views, viewing.viewpoints)]
        arrays += [viewing.points[0] for viewing in both]
        sizes = [np.int32(size) for viewing in both for size in (viewing.points[0].shape[1], viewing.points[1])]
        numbers = np.int32(images[0]), *sizes, np.int32(len(tolerances)), _float4(*tolerances[0], *tolerances[-1])
        size, edge = (1 if device.is_cpu else _GROUP, n, sum(images)), arrays[0].shape[1]
        arguments = *arrays, poses, counts, *numbers
        launch(device, "points/visibility", "agreement", size, *arguments, group=(size[0], 1, 1), EDGE=edge)
    copy = Readback(device, counts)
    return Pending(lambda: np.split(copy.read().astype(np.int64), np.cumsum(images)[:-1]))


@cache
def _float4(x: float, y: float, z: float, w: float) -> np.void:
    """A float4 kernel argument, cached because PyOpenCL takes as long to make it as to launch a kernel."""
    # pyrefly: ignore[missing-attribute]
    return cltypes.make_float4(x, y, z, w)
