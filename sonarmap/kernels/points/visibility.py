"""Points under many poses against a range image: which agree with it, and which stand where its beams went through."""

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

_LANES = 8
_GROUP = 64


def octahedral_cells(directions: np.ndarray, edge: int) -> np.ndarray:
    """(n,) int64 the cells of an octahedral map, edge x edge in C order, that directions (n, 3) of any length fall
    into.

    The octahedron |x| + |y| + |z| = 1 unfolded to a square (Engelhardt and Dachsbacher, "Octahedron environment maps",
    VMV 2008): no poles, and cells whose sizes differ by no more than a factor of 5.2. A zero vector counts as +z.
    """
    columns = np.ascontiguousarray(directions.T)  # column by column, which is faster than row by row
    x, y, z = columns / np.maximum(np.abs(columns).sum(axis=0), 1e-20)
    folded_u, folded_v = (1 - np.abs(y)) * np.where(x < 0, -1, 1), (1 - np.abs(x)) * np.where(y < 0, -1, 1)
    u, v = np.where(z < 0, folded_u, x), np.where(z < 0, folded_v, y)
    i, j = (np.clip(((side + 1) * (0.5 * edge)).astype(np.int64), 0, edge - 1) for side in (u, v))
    return i * edge + j


def upload_points(device: Device, points: np.ndarray) -> tuple[cla.Array, int]:
    """Points (n, 3) on the device for `agreement`, and how many they are: (3, n padded to a multiple of 8) float32."""
    padded = np.zeros((3, -(-max(len(points), 1) // _LANES) * _LANES), np.float32)
    padded[:, : len(points)] = points.T
    return device.to_device(padded), len(points)


def upload_viewpoints(device: Device, places: np.ndarray) -> cla.Array:
    """Where the sensors of k range images were (k, 3), on the device for `agreement`: (k, 4) float32."""
    return upload_places(device, places)


@dataclass(frozen=True, slots=True)
class Viewing:
    """Points of one scan, and the range images of another that they are put into."""

    # device (k, edge, edge, 2) float32, nearest and farthest range of every cell of an octahedral map, (inf, -inf)
    # where nothing was seen; None for no image
    views: cla.Array | None
    # from `upload_viewpoints`, in the frame of the images' scan [any length unit]; None for no image
    viewpoints: cla.Array | None
    points: tuple[cla.Array, int]  # from `upload_points`, in their scan's frame [the same unit]


def agreement(
    device: Device, viewings: Sequence[Viewing], poses: cla.Array, tolerances: Sequence[tuple[float, float]]
) -> Pending[list[np.ndarray]]:
    """Queue how points, moved by each pose, agree with what sensors saw; one launch for all.

    Args:
        viewings: one, or two with images of the same edge.
        poses: device (n, 16) float32 as `upload_poses` makes them, which bring the first viewing's points to its
            images; the second's are brought by the inverse.
        tolerances: one or two of (reach, slope): a range within reach + slope * range of the cell's agrees; nearer
            contradicts, and farther is hidden. Not negative.

    Returns:
        Of each viewing (k, n, tolerances, 3) int64: points that agree, that contradict, and that fall into cells where
        something was seen.
    """
    images = [0 if viewing.views is None else len(viewing.views) for viewing in viewings]
    n, _ = require_array(poses, "poses", (None, 16))
    counts = device.empty((sum(images), n, len(tolerances), 3), np.int32)
    seeing = [viewing for viewing in viewings if viewing.views is not None]
    if counts.size:
        both = viewings[0], viewings[-1]
        # a viewing without an image has no job, but an argument
        shown = [seeing[0] if viewing.views is None else viewing for viewing in both]
        arrays = [cast(cla.Array, array) for viewing in shown for array in (viewing.views, viewing.viewpoints)]
        arrays += [viewing.points[0] for viewing in both]
        sizes = [np.int32(size) for viewing in both for size in (viewing.points[0].shape[1], viewing.points[1])]
        numbers = np.int32(images[0]), *sizes, _float4(*tolerances[0], *tolerances[-1])
        size, defines = (1 if device.is_cpu else _GROUP, n, sum(images)), {"TOLERANCES": len(tolerances)}
        defines["EDGE"] = arrays[0].shape[1]
        arguments = *arrays, poses, counts, *numbers
        launch(device, "points/visibility", "agreement", size, *arguments, group=(size[0], 1, 1), **defines)
    copy = Readback(device, counts)
    return Pending(lambda: np.split(copy.read().astype(np.int64), np.cumsum(images)[:-1]))


@cache
def _float4(x: float, y: float, z: float, w: float) -> np.void:
    """A kernel argument; PyOpenCL takes as long to make it as to launch a kernel."""
    # pyrefly: ignore[missing-attribute]
    return cltypes.make_float4(x, y, z, w)
