"""What is read later is what an array held when it was asked for."""

import numpy as np
import pytest

from kernels.device.later import Later
from kernels.device.launch import zero


@pytest.mark.parametrize("shape", [(3,), (5, 7), (2, 64, 33)])
def test_what_follows_does_not_change_it(device, shape):
    values = np.random.default_rng(len(shape)).normal(size=shape).astype(np.float32)
    array = device.to_device(values)
    later = Later(device, array)
    zero(device, array)
    np.testing.assert_array_equal(later.get(), values)
    np.testing.assert_array_equal(later.get(), values)


def test_a_slice_may_begin_anywhere(device):
    values = np.random.default_rng(4).normal(size=(3, 7)).astype(np.float32)
    np.testing.assert_array_equal(Later(device, device.to_device(values)[1:]).get(), values[1:])


def test_the_array_may_be_gone(device):
    values = np.arange(100_000, dtype=np.complex64)
    later = Later(device, device.to_device(values))
    np.testing.assert_array_equal(later.get(), values)
