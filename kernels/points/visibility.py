# pyright: strict, reportUnknownVariableType=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
"""Points under many poses against a range image: which agree with it, and which stand where its beams went through."""

import numpy as np
import pyopencl.array as cla

from kernels.device.device import Device
from kernels.device.launch import launch, require_array
from kernels.errors import InputError

_LANES = 8
_PART = 256  # points of one work-item


def octahedral_cells(directions: np.ndarray, edge: int) -> np.ndarray:
    """The cells of an octahedral map, edge x edge, that directions fall into.

    The octahedron |x| + |y| + |z| = 1 unfolded to a square (Engelhardt and Dachsbacher, "Octahedron environment maps",
    VMV 2008): no poles, and cells whose sizes differ by no more than a factor of 5.2.

    Args:
        directions: (n, 3), of any length; a zero vector counts as +z.
        edge: cells along each side of the square.

    Returns:
        (n,) int64, numbers of cells in C order.

    Raises:
        InputError: the directions have another shape or are not finite, or there is no cell.
    """
    _require_places(directions, "directions")
    if edge < 1:
        raise InputError(f"`edge={edge}` cells are too few; give at least 1")
    x, y, z = np.moveaxis(directions / np.maximum(np.abs(directions).sum(axis=1, keepdims=True), 1e-20), -1, 0)
    folded_u, folded_v = (1 - np.abs(y)) * np.where(x < 0, -1, 1), (1 - np.abs(x)) * np.where(y < 0, -1, 1)
    u, v = np.where(z < 0, folded_u, x), np.where(z < 0, folded_v, y)
    i, j = (np.clip(((side + 1) * (0.5 * edge)).astype(np.int64), 0, edge - 1) for side in (u, v))
    return i * edge + j


def upload_points(device: Device, points: np.ndarray) -> tuple[cla.Array, int]:
    """Points (n, 3) on the device for `agreement`, and how many they are: (3, n padded to a multiple of 8) float32.

    Raises:
        InputError: the points have another shape, or are not finite.
    """
    _require_places(points, "points")
    padded = np.zeros((3, -(-max(len(points), 1) // _LANES) * _LANES), np.float32)
    padded[:, : len(points)] = points.T
    return device.to_device(padded), len(points)


def agreement(
    device: Device,
    view: cla.Array,
    points: tuple[cla.Array, int],
    R: np.ndarray,
    t: np.ndarray,
    reach: float,
    slope: float,
) -> np.ndarray:
    """How the points, moved by each pose, agree with what a sensor at the origin saw.

    Args:
        view: (edge, edge, 2) float32, nearest and farthest range of every cell of an octahedral map, (inf, -inf) where
            nothing was seen.
        points: from `upload_points`, in a frame of their own [any length unit].
        R, t: (n, 3, 3) and (n, 3), to the sensor's frame.
        reach, slope: a range within reach + slope * range of the cell's agrees; nearer contradicts, and farther is
            hidden. Not negative.

    Returns:
        (n, 3) int64: points that agree, that contradict, and that fall into cells where something was seen.

    Raises:
        InputError: a shape is another, or a pose, the reach or the slope is no such number.
    """
    edge, across, _ = require_array(view, "view", (None, None, 2))
    moved, valid = points
    _, count = require_array(moved, "points", (3, None))
    if across != edge or count % _LANES or not 0 <= valid <= count:
        raise InputError(
            f"`view` has {edge} x {across} cells, `points` {valid} of {count}; wanted a square view, and points as "
            "upload_points makes them"
        )
    if R.shape != (len(R), 3, 3) or t.shape != (len(R), 3):
        raise InputError(f"`R` and `t` have shapes {R.shape} and {t.shape}; wanted (n, 3, 3) and (n, 3)")
    if not (np.isfinite(R).all() and np.isfinite(t).all() and 0 <= reach < np.inf and 0 <= slope < np.inf):
        raise InputError(f"`reach={reach}`, `slope={slope}`; wanted 0 or more, and finite `R` and `t`")
    if not len(R):
        return np.zeros((0, 3), np.int64)
    rows = np.zeros((len(R), 16), np.float32)
    rows[:, :12] = np.concatenate([R, t[:, :, None]], axis=2).reshape(-1, 12)
    parts = -(-count // _PART)
    counts = device.empty((len(R), parts, 3), np.int32)
    numbers = np.int32(count), np.int32(valid), np.float32(reach), np.float32(slope)
    arrays = view, moved, device.to_device(rows), counts
    launch(device, "points/visibility", "agreement", (parts, len(R)), *arrays, *numbers, EDGE=edge, PART=_PART)
    return counts.get().sum(axis=1, dtype=np.int64)


def _require_places(places: np.ndarray, what: str) -> None:
    if places.ndim != 2 or places.shape[1] != 3 or not np.isfinite(places).all():
        raise InputError(f"`{what}` have shape {places.shape}; wanted (n, 3), all of it finite numbers")
