"""Device arrays: recycled memory, asynchronous copies to the host, and poses and points in the layout of kernels."""

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
    """An uninitialized array from a pool, which reuses its memory once nothing refers to it. Slices of it cannot be
    passed to kernels; otherwise as `Device.empty`."""
    device.require(int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize)
    with device.explain_full_memory():
        if device not in _POOLS:
            _POOLS[device] = MemoryPool(ImmediateAllocator(device.queue))
        return cla.empty(device.queue, shape, dtype, allocator=device.allocator or _POOLS[device])


def free_recycled() -> None:
    """Return unused memory of the pools to the system."""
    gc.collect()  # collects arrays in reference cycles
    for pool in _POOLS.values():
        pool.free_held()
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "malloc_trim"):  # glibc keeps freed memory
        libc.malloc_trim(0)


T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Pending(Generic[T]):
    """The result of queued kernels; `read` waits until it has arrived."""

    read: Callable[[], T]


class Readback:
    """A copy of a device array on the host, taken after all commands that are queued."""

    def __init__(self, device: Device, array: cla.Array) -> None:
        """Queue the copy without waiting; commands queued later may overwrite the array."""
        self._host: np.ndarray[Any, Any] = np.empty(array.shape, array.dtype)
        self._array = array  # keeps its memory from being reused before the copy
        self._copied: cl.Event | None = None
        if array.nbytes:
            with device.explain_full_memory():
                self._copied = cl.enqueue_copy(
                    device.queue, self._host, memory_of(array), src_offset=array.offset, is_blocking=False
                )
                device.queue.flush()

    def read(self) -> np.ndarray[Any, Any]:
        """The copy, after waiting for it if necessary."""
        if self._copied is not None:
            if self._copied.command_execution_status != cl.command_execution_status.COMPLETE:
                self._copied.wait()
            self._copied = None
        return self._host


def upload_poses(device: Device, R: np.ndarray, t: np.ndarray) -> cla.Array:
    """Device (k, 16) float32, the rows of [R | t] in the first 12, from (k, 3, 3) rotations and (k, 3) shifts."""
    if R.shape != (len(R), 3, 3) or t.shape != (len(R), 3) or not (np.isfinite(R).all() and np.isfinite(t).all()):
        raise InputError(f"`R` and `t` have shapes {R.shape} and {t.shape}; wanted finite (n, 3, 3) and (n, 3)")
    rows = np.zeros((len(R), 4, 4), np.float32)
    rows[:, :3, :3], rows[:, :3, 3] = R, t
    return device.to_device(rows.reshape(-1, 16))


def upload_places(device: Device, points: np.ndarray) -> cla.Array:
    """Device (n, 4) float32, the points (n, 3) and 0, which kernels move by poses."""
    rows = np.zeros((len(points), 4), np.float32)
    rows[:, :3] = points
    return device.to_device(rows)
