"""Device arrays: memory that is used again, results on their way to the host, poses and places as kernels take them."""

import ctypes
import gc
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
import pyopencl as cl
import pyopencl.array as cla
from pyopencl.tools import ImmediateAllocator, MemoryPool

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import memory_of
from sonarmap.kernels.errors import InputError

_POOLS: WeakKeyDictionary[Device, MemoryPool] = WeakKeyDictionary()


def recycled(device: Device, shape: tuple[int, ...], dtype: type | np.dtype = np.float32) -> cla.Array:
    """An uninitialized array, as `Device.empty` gives it; slices of it cannot be passed to kernels. Its memory goes to
    the next one of about its size once nothing refers to it."""
    device.require(int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize)
    with device.explain_full_memory():
        if device not in _POOLS:
            _POOLS[device] = MemoryPool(ImmediateAllocator(device.queue))
        return cla.empty(device.queue, shape, dtype, allocator=device.allocator or _POOLS[device])


def free_recycled() -> None:
    """Give the system back what no array uses, until new ones are made."""
    gc.collect()  # arrays that refer to one another
    for pool in _POOLS.values():
        pool.free_held()
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "malloc_trim"):  # glibc keeps what is freed
        libc.malloc_trim(0)


T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Pending(Generic[T]):
    """What a kernel that is queued will say; `read` waits for it, if it is not there yet."""

    read: Callable[[], T]


class Readback:
    """The copy of a device array, as what is queued before it leaves it."""

    def __init__(self, device: Device, array: cla.Array) -> None:
        """Queue the copy, without waiting; the array may be used again by what is queued after it."""
        self._host: np.ndarray[Any, Any] = np.empty(array.shape, array.dtype)
        self._array = array  # whose memory must not go to another one before
        self._copied: cl.Event | None = None
        if array.nbytes:
            with device.explain_full_memory():
                self._copied = cl.enqueue_copy(
                    device.queue, self._host, memory_of(array), src_offset=array.offset, is_blocking=False
                )
                device.queue.flush()

    def read(self) -> np.ndarray[Any, Any]:
        """The array; waits only where it is not there yet."""
        if self._copied is not None:
            if self._copied.command_execution_status != cl.command_execution_status.COMPLETE:
                self._copied.wait()
            self._copied = None
        return self._host


def upload_poses(device: Device, R: np.ndarray, t: np.ndarray) -> cla.Array:
    """Device (k, 16) float32, the rows of [R | t] in the first 12, of (k, 3, 3) rotations and (k, 3) shifts [any
    unit]."""
    if R.shape != (len(R), 3, 3) or t.shape != (len(R), 3) or not (np.isfinite(R).all() and np.isfinite(t).all()):
        raise InputError(f"`R` and `t` have shapes {R.shape} and {t.shape}; wanted finite (n, 3, 3) and (n, 3)")
    rows = np.zeros((len(R), 4, 4), np.float32)
    rows[:, :3, :3], rows[:, :3, 3] = R, t
    return device.to_device(rows.reshape(-1, 16))


def upload_places(device: Device, points: np.ndarray) -> cla.Array:
    """Points (n, 3) on the device, to be moved by poses: (n, 4) float32."""
    rows = np.zeros((len(points), 4), np.float32)
    rows[:, :3] = points
    return device.to_device(rows)
