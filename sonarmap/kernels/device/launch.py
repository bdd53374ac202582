"""Launch kernels and check their arrays, for the Python functions of all kernels."""

from collections.abc import Mapping
from math import gcd, prod
from types import MappingProxyType
from typing import cast
from weakref import WeakKeyDictionary

import numpy as np
import pyopencl as cl
import pyopencl.array as cla
from pyopencl import cltypes

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.drivers import refuse_fork
from sonarmap.kernels.errors import InputError

Shape = tuple[int, ...]

# What a work-item computes -> work-group (CPU, GPU). Groups are launched whole: surplus work-items have to return.
GROUPS: Mapping[str, tuple[Shape, Shape]] = MappingProxyType(
    {
        "numbers": ((32,), (256,)),  # 8 adjacent numbers (CPU) or one (GPU) of an array without rows
        "columns": ((1, 1), (64, 4)),  # 8 adjacent numbers or one; then layers or rows
        "rows": ((1, 8, 1), (64, 4, 1)),  # a row (CPU) or one number of it (GPU); then rows and planes
        "planes": ((1, 1, 1), (64, 4, 1)),  # as rows, for kernels that take long for a row
        "sums": ((1,), (128,)),  # a group sums a row or an image
        # a point, in both flavors: a processor's compiler vectorizes the loop over the group; then poses
        "points": ((256, 1), (256, 1)),
    }
)
# largest work-group of kernels without a `group`, by number of dimensions
_PLAIN: tuple[Shape, ...] = ((), (256,), (64, 4), (64, 4, 1))


def lanes(device: Device) -> int:
    """Number of adjacent numbers that a work-item takes (LANES in lanes.cl)."""
    return 8 if device.is_cpu else 1


def along(device: Device, count: int) -> int:
    """Work-items per row of `count` numbers (ALONG in lanes.cl): a single one on processors, else one per number."""
    return 1 if device.is_cpu else count


def team(device: Device) -> int:
    """Work-items in a group of "sums"."""
    return GROUPS["sums"][0 if device.is_cpu else 1][0]


def arrange(device: Device, size: Shape, group: str | Shape | None, most: int) -> tuple[Shape, Shape]:
    """Global size and work-group size of a launch of `size` work-items.

    `group` is a key of GROUPS, shrunk to `most` work-items, with the size rounded up to whole groups; a group to use as
    it is; or None: single work-items on a processor, elsewhere the largest powers of two that divide the size.
    """
    if isinstance(group, str):
        fitting = _shrink(GROUPS[group][0 if device.is_cpu else 1], most)
        return tuple(-(-n // g) * g for n, g in zip(size, fitting, strict=True)), fitting
    if group is not None:
        return size, group
    if device.is_cpu:
        return size, (1,) * len(size)
    return size, tuple(gcd(n, g) for n, g in zip(size, _shrink(_PLAIN[len(size)], most), strict=True))


def _shrink(group: Shape, most: int) -> Shape:
    """The group with its longest dimension halved until the device can run it."""
    while prod(group) > most:
        longest = group.index(max(group))
        group = tuple(n // 2 if axis == longest else n for axis, n in enumerate(group))
    return group


# Kernels are kept: each `program.name` makes a new kernel object, and reading a source takes longer than a launch.
_KERNELS: WeakKeyDictionary[Device, dict[tuple, tuple[cl.Kernel, int]]] = WeakKeyDictionary()
_TABLES: WeakKeyDictionary[Device, dict[tuple, cla.Array]] = WeakKeyDictionary()
_MOST_ITEMS = cl.kernel_work_group_info.WORK_GROUP_SIZE
_TABLES_KEPT = 128
_CLEARED = 4096  # bytes that a work-item of `zero` clears
_FLOAT = 4  # bytes


def launch(
    device: Device,
    program: str,
    kernel: str,
    size: tuple[int, ...],
    *arguments: cla.Array | cl.Buffer | np.generic,
    group: str | tuple[int, ...] | None = None,
    **defines: int | float,
) -> None:
    """Enqueue one kernel of `kernels/<program>.cl`; the kernel object is made once per device.

    Args:
        size: number of work-items along each dimension.
        arguments: device arrays (or slices of them along the first axis), NumPy scalars, and buffers of `memory_of`
            for a kernel that takes the offset of a slice as another argument.
        group: as in `arrange`; with a key of GROUPS, surplus work-items of the kernel have to return.
        defines: macros of the program.
    """
    kernels = _KERNELS.setdefault(device, {})
    key = (program, kernel, *defines.items())
    if key not in kernels:
        made = cl.Kernel(device.program(program, **defines), kernel)
        # PyOpenCL takes five times as long for numbers of undeclared type
        made.set_scalar_arg_dtypes([value.dtype if isinstance(value, np.generic) else None for value in arguments])
        kernels[key] = made, made.get_work_group_info(_MOST_ITEMS, device.context.devices[0])
    made, most = kernels[key]
    items, group = arrange(device, size, group, most)
    enqueue(device, made, items, *arguments, group=group)


def enqueue(
    device: Device,
    kernel: cl.Kernel,
    size: tuple[int, ...],
    *arguments: cla.Array | cl.Buffer | np.generic,
    group: tuple[int, ...] | None,
) -> None:
    """Enqueue a kernel of a generated program; arguments and errors as in `launch`."""
    refuse_fork()
    # most arrays begin with their buffer: a call for each of 3000 arguments of a pair would take a millisecond
    values = [
        value if not isinstance(value, cla.Array) else buffer_of(device, value) if value.offset else memory_of(value)
        for value in arguments
    ]
    try:
        kernel(device.queue, size, group, *values)
    except (cl.MemoryError, cl.RuntimeError):
        with device.explain_full_memory():
            raise


def buffer_of(device: Device, array: cla.Array) -> cl.Buffer:
    """The sub-buffer of a slice along the first axis, as a kernel argument."""
    alignment = device.cl_device.mem_base_addr_align // 8
    if array.offset % alignment:
        raise InputError(
            f"a slice of a device array begins {array.offset} bytes into it; {device.name} needs "
            f"a multiple of {alignment}: copy the slice first"
        )
    return memory_of(array).get_sub_region(array.offset, array.nbytes)


def zero(device: Device, array: cla.Array) -> None:
    """Fill an array with zero bytes (`Array.fill` is 50 times slower on PoCL, as its fill has one thread)."""
    whole = array.nbytes // _CLEARED if device.is_cpu else 0
    if whole:
        launch(device, "device/clear", "clear", (whole,), array, BYTES=_CLEARED)
    rest = array.nbytes - whole * _CLEARED
    if rest:
        pattern, begin = np.zeros(1, np.float32), array.offset + whole * _CLEARED
        with device.explain_full_memory():
            cl.enqueue_fill_buffer(device.queue, cast(cl.Buffer, array.base_data), pattern, begin, rest)


def table(device: Device, values: np.ndarray) -> cla.Array:
    """A small constant array on the device, uploaded once and cached by its content."""
    tables = _TABLES.setdefault(device, {})
    key = (values.tobytes(), values.shape, values.dtype.str)
    if key not in tables:
        if len(tables) >= _TABLES_KEPT:
            del tables[next(iter(tables))]
        tables[key] = device.to_device(values)
    return tables[key]


def affine(R: np.ndarray | None = None, offset: np.ndarray | None = None) -> np.void:
    """A rotation and a shift as one float16 kernel argument: rows of [R | offset] in s0123, s4567, s89ab."""
    rows = affine_rows(R, offset).ravel()
    # pyrefly: ignore[missing-attribute]
    return cltypes.make_float16(*rows)


def affine_rows(R: np.ndarray | None = None, offset: np.ndarray | None = None) -> np.ndarray:
    """(..., 4, 4) float64 homogeneous matrices; InputError if an `R` is no rotation or an `offset` not finite."""
    turn = np.eye(3) if R is None else np.asarray(R, np.float64)
    shift = np.zeros(3) if offset is None else np.asarray(offset, np.float64)
    # not `allclose`, which takes longer than a launch
    if turn.shape[-2:] != (3, 3) or not np.abs(turn @ turn.mT - np.eye(3)).max(initial=0.0) <= 1e-4:
        raise InputError(f"`R` is {turn.tolist()}; wanted a (3, 3) rotation matrix")
    if (np.linalg.det(turn) < 0).any():
        raise InputError(f"`R` is {turn.tolist()}, a reflection; wanted a (3, 3) rotation matrix: negate one axis")
    if shift.shape != turn.shape[:-1] or not np.isfinite(shift).all():
        raise InputError(f"`offset` is {shift.tolist()}; wanted 3 finite numbers")
    rows = np.zeros((*turn.shape[:-2], 4, 4))
    rows[..., :3, :3], rows[..., :3, 3], rows[..., 3, 3] = turn, shift, 1.0
    return rows


def require_array(
    array: cla.Array, what: str, shape: tuple[int | None, ...], dtype: type = np.float32
) -> tuple[int, ...]:
    """Check a device array's shape (None: any length), dtype and C order, and return its shape."""
    fits = len(array.shape) == len(shape) and all(
        wanted in (None, length) for wanted, length in zip(shape, array.shape, strict=True)
    )
    if not fits or array.dtype != dtype or not array.flags.c_contiguous:
        wanted = ", ".join("any" if length is None else str(length) for length in shape)
        raise InputError(
            f"`{what}` is {array.dtype} of shape {array.shape}; wanted {np.dtype(dtype)} of shape ({wanted}), "
            "in C order"
        )
    return array.shape


def output(
    device: Device, out: cla.Array | None, what: str, shape: tuple[int, ...], dtype: type = np.float32
) -> cla.Array:
    """`out` if its shape and dtype are right, or a new array if it is None."""
    if out is None:
        return device.empty(shape, dtype)
    require_array(out, what, shape, dtype)
    return out


def memory_of(array: cla.Array) -> cl.Buffer:
    """The whole buffer that contains an array or a slice, `array.offset` bytes from its beginning."""
    # pyrefly: ignore[bad-return]
    return array.base_data


def begin_of(array: cla.Array) -> np.uint64:
    """Offset of an array in its `memory_of` buffer [floats]."""
    return np.uint64(array.offset // _FLOAT)
