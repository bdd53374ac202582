"""Asynchronous copies to the host, and arrays that reuse the memory of deleted ones."""

import gc
from typing import Any

import numpy as np
import pytest

from sonarmap.kernels.device import arrays as pools
from sonarmap.kernels.device.arrays import Readback, free_recycled, recycled
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import zero
from sonarmap.kernels.device.trace import Counts, tracing
from sonarmap.kernels.errors import DeviceError


def test_copy_has_the_contents_at_the_time_of_queuing(device: Device) -> None:
    values = np.arange(5000, dtype=np.float32).reshape(5, 1000)
    array = device.to_device(values)
    before, part = Readback(device, array), Readback(device, array[2:4])
    zero(device, array)
    after = Readback(device, array)
    assert not after.read().any()
    np.testing.assert_array_equal(before.read(), values)
    np.testing.assert_array_equal(part.read(), values[2:4])
    np.testing.assert_array_equal(before.read(), values)


def test_waiting_for_the_last_copy_completes_all(device: Device) -> None:
    counts = Counts()
    with tracing(device, lambda: counts):
        readbacks = [Readback(device, device.to_device(np.full(1000, n))) for n in range(4)]
        assert counts.reads == 0
        numbers = [readback.read()[7] for readback in readbacks[::-1]]
    assert numbers == [3, 2, 1, 0]
    assert counts.reads <= 1


@pytest.mark.parametrize("shape", [(3, 7), (100_000,), (1, 3)])
def test_slices_at_any_offset_of_deleted_arrays(device: Device, shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(4).normal(size=shape).astype(np.complex64)
    readback = Readback(device, device.to_device(values)[1:])
    np.testing.assert_array_equal(readback.read(), values[1:])


def place(array: Any) -> int:
    """Address of the memory of an array."""
    return array.base_data.int_ptr


def test_memory_is_reused_once_nothing_refers_to_it(device):
    """Also by arrays of another shape and type."""
    first, second = (recycled(device, (64, 1024)) for _ in range(2))
    second.set(np.full((64, 1024), 2.0, np.float32))
    kept = second.reshape(1024, 64)  # refers to the same memory
    freed, taken = place(first), place(second)
    assert freed != taken
    del first, second
    gc.collect()
    third = recycled(device, (1024, 32), np.complex64)
    assert place(third) == freed
    values = (np.arange(2**15) * (1 + 2j)).reshape(1024, 32).astype(np.complex64)
    third.set(values)
    np.testing.assert_array_equal(third.get(), values)
    assert (kept.get() == 2.0).all()
    with pytest.raises(DeviceError, match="on the device"):
        recycled(device, (2**20, 2**20))


def test_unused_memory_is_freed(device: Device) -> None:
    kept, gone = (recycled(device, (64, 1024)) for _ in range(2))
    kept.set(np.full((64, 1024), 3.0, np.float32))
    del gone
    pool = pools._POOLS[device]
    free_recycled()
    assert pool.held_blocks == 0
    assert pool.active_blocks >= 1
    assert (kept.get() == 3.0).all()
