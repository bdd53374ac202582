# pyright: strict, reportUnknownVariableType=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
"""Points under many poses against a range image: which agree with it, and which stand where its beams went through."""

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import pyopencl as cl
import pyopencl.array as cla
from pyopencl import cltypes

from kernels.device.device import Device
from kernels.device.launch import buffer_of, launch, require_array
from kernels.errors import InputError

_LANES = 8
_GROUP = 64
_SCRATCH: WeakKeyDictionary[Device, dict[str, cla.Array]] = WeakKeyDictionary()


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


@dataclass(frozen=True, slots=True)
class Way:
    """Points of one scan, and the range images of another that they are put into.

    Attributes:
        views: device (k, edge, edge, 2) float32, nearest and farthest range of every cell of an octahedral map,
            (inf, -inf) where nothing was seen; None for no image.
        points: from `upload_points`, in a frame of their own [any length unit].
        R: (n, 3, 3) rotations to the sensor's frame.
        t: (k, n, 3) shifts to that of each image.
    """

    views: cla.Array | None
    points: tuple[cla.Array, int]
    R: np.ndarray
    t: np.ndarray


def agreement(device: Device, ways: Sequence[Way], tolerances: Sequence[tuple[float, float]]) -> list[np.ndarray]:
    """How points, moved by each pose, agree with what sensors saw; one launch and one blocking read for all.

    Args:
        ways: one, or two with as many poses and images of the same edge.
        tolerances: one or two of (reach, slope): a range within reach + slope * range of the cell's agrees; nearer
            contradicts, and farther is hidden. Not negative.

    Returns:
        Of each way (k, n, tolerances, 3) int64: points that agree, that contradict, and that fall into cells where
        something was seen.

    Raises:
        InputError: a shape is another, or a pose or a tolerance is no such number.
    """
    bad = [pair for pair in tolerances if not (0 <= pair[0] < np.inf and 0 <= pair[1] < np.inf)]
    if bad or len(tolerances) not in (1, 2) or len(ways) not in (1, 2):
        raise InputError(f"{len(ways)} ways, `tolerances={tolerances}`; wanted one or two of each, 0 or more")
    jobs, n, edge = [_images(way) for way in ways], len(ways[0].R), _edge(ways)
    shapes = [(images, n, len(tolerances), 3) for images in jobs]
    if not n or not sum(jobs):
        return [np.zeros(shape, np.int64) for shape in shapes]
    rows = np.empty((sum(jobs), n, 3, 4), np.float32)
    for way, part in zip(ways, np.split(rows, jobs[:1]), strict=False):
        part[..., :3], part[..., 3] = way.R, way.t
    scratch = _SCRATCH.setdefault(device, {})
    poses = _at_least(device, scratch, "poses", rows.size, np.float32)
    counts = _at_least(device, scratch, "counts", int(np.prod(shapes[0][1:])) * sum(jobs), np.int32)
    # not waited for: the read below is
    cl.enqueue_copy(device.queue, buffer_of(device, poses), rows, is_blocking=False)
    first, second = ways[0], ways[-1]
    seen = next(way.views for way in ways if way.views is not None)
    views = [seen if way.views is None else way.views for way in (first, second)]
    sizes = [np.int32(number) for way in (first, second) for number in (way.points[0].shape[1], way.points[1])]
    both = cltypes.make_float4(*tolerances[0], *tolerances[-1])  # pyright: ignore[reportAttributeAccessIssue]
    cpu = device.is_cpu
    launch(
        device, "points/visibility", "agreement", (n, sum(jobs)) if cpu else (_GROUP, n, sum(jobs)),
        *views, first.points[0], second.points[0], poses, counts, np.int32(jobs[0]), *sizes, both,
        group=None if cpu else (_GROUP, 1, 1), EDGE=edge, TOLERANCES=len(tolerances), CPU=int(cpu),
    )  # fmt: skip
    read = counts[: sum(jobs) * n * len(tolerances) * 3].get().astype(np.int64).reshape(-1, *shapes[0][1:])
    return np.split(read, np.cumsum(jobs)[:-1])


def _images(way: Way) -> int:
    """How many images a way has, once all its shapes are right."""
    images = 0 if way.views is None else len(way.views)
    moved, valid = way.points
    _, count = require_array(moved, "points", (3, None))
    if count % _LANES or not 0 <= valid <= count:
        raise InputError(f"`points` are {valid} of {count}; wanted points as upload_points makes them")
    if way.R.shape != (len(way.R), 3, 3) or way.t.shape != (images, len(way.R), 3):
        raise InputError(
            f"`R` and `t` have shapes {way.R.shape} and {way.t.shape}; wanted (n, 3, 3) and ({images}, n, 3)"
        )
    if not (np.isfinite(way.R).all() and np.isfinite(way.t).all()):
        raise InputError("`R` or `t` holds numbers that are not finite")
    return images


def _edge(ways: Sequence[Way]) -> int:
    """The edge of all images."""
    edges = {way.views.shape[1] for way in ways if way.views is not None}
    for way in ways:
        if way.views is not None:
            require_array(way.views, "views", (None, *2 * (min(edges),), 2))
        if len(way.R) != len(ways[0].R):
            raise InputError(f"ways have {len(ways[0].R)} and {len(way.R)} poses; wanted as many")
    return min(edges, default=0)


def _at_least(device: Device, scratch: dict[str, cla.Array], name: str, size: int, dtype: type) -> cla.Array:
    """An array that is used again by every call, made anew where it is too small."""
    if name not in scratch or scratch[name].size < size:
        scratch[name] = device.empty((1 << (size - 1).bit_length(),), dtype)
    return scratch[name]


def _require_places(places: np.ndarray, what: str) -> None:
    if places.ndim != 2 or places.shape[1] != 3 or not np.isfinite(places).all():
        raise InputError(f"`{what}` have shape {places.shape}; wanted (n, 3), all of it finite numbers")
