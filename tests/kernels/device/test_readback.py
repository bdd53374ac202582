"""Copies that are queued, and waited for when they are wanted."""

import numpy as np

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import zero
from sonarmap.kernels.device.readback import Readback
from sonarmap.kernels.device.trace import Counts, tracing


def test_it_holds_what_was_there_when_it_was_queued(device: Device) -> None:
    values = np.arange(5000, dtype=np.float32).reshape(5, 1000)
    array = device.to_device(values)
    before, part = Readback(device, array), Readback(device, array[2:4])
    zero(device, array)
    after = Readback(device, array)
    assert not after.read().any()
    np.testing.assert_array_equal(before.read(), values)
    np.testing.assert_array_equal(part.read(), values[2:4])
    np.testing.assert_array_equal(before.read(), values)


def test_the_last_is_waited_for_and_brings_all(device: Device) -> None:
    counts = Counts()
    with tracing(device, lambda: counts):
        readbacks = [Readback(device, device.to_device(np.full(1000, n))) for n in range(4)]
        assert counts.reads == 0
        numbers = [readback.read()[7] for readback in readbacks[::-1]]
    assert numbers == [3, 2, 1, 0]
    assert counts.reads <= 1
    assert counts.read_bytes == 4 * 8000


def test_nothing_is_there_at_once(device: Device) -> None:
    assert Readback(device, device.empty((0, 3))).read().shape == (0, 3)


def test_a_slice_may_begin_anywhere(device):
    values = np.random.default_rng(4).normal(size=(3, 7)).astype(np.float32)
    np.testing.assert_array_equal(Readback(device, device.to_device(values)[1:]).read(), values[1:])


def test_the_array_may_be_gone(device):
    values = np.arange(100_000, dtype=np.complex64)
    readback = Readback(device, device.to_device(values))
    np.testing.assert_array_equal(readback.read(), values)
