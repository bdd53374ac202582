"""Large arrays that live as long as a prepared scan, in memory that earlier ones left behind.

The first touch of new memory costs more than a Fourier transform: the system hands it out page by page, each cleared.
"""

import ctypes
import gc
import sys
from weakref import WeakKeyDictionary

import numpy as np
import pyopencl.array as cla
from pyopencl.tools import ImmediateAllocator, MemoryPool

from sonarmap.kernels.device.device import Device

_POOLS: WeakKeyDictionary[Device, MemoryPool] = WeakKeyDictionary()


def recycled(device: Device, shape: tuple[int, ...], dtype: type | np.dtype = np.float32) -> cla.Array:
    """An uninitialized array, as `Device.empty` gives it; slices of it cannot be passed to kernels.

    Its memory goes to the next one of about its size once nothing refers to the array: what is queued comes before.
    """
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
