"""Memory of arrays that are gone goes to the next ones, and to no other."""

import gc
from typing import Any

import numpy as np
import pytest

from sonarmap.kernels.device.recycled import recycled
from sonarmap.kernels.errors import DeviceError


def place(array: Any) -> int:
    """Which memory an array is in."""
    return array.base_data.int_ptr


def test_memory_is_used_again_once_nothing_refers_to_it(device):
    first, second = (recycled(device, (64, 1024)) for _ in range(2))
    first.fill(1.0)
    second.fill(2.0)
    kept = second.reshape(1024, 64)  # refers to the same memory
    places = {place(array) for array in (first, second)}
    assert len(places) == 2
    freed = place(first)
    del first, second
    gc.collect()
    third = recycled(device, (1024, 64))
    assert place(third) == freed
    third.fill(3.0)
    assert (kept.get() == 2.0).all()


def test_other_shapes_and_types_fit_too(device):
    array = recycled(device, (3, 5, 7), np.complex64)
    values = (np.arange(105) * (1 + 2j)).reshape(3, 5, 7).astype(np.complex64)
    array.set(values)
    np.testing.assert_array_equal(array.get(), values)


def test_refuses_more_than_the_device_has(device):
    with pytest.raises(DeviceError, match="on the device"):
        recycled(device, (2**20, 2**20))
