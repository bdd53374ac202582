"""How fast the device copies what no cache holds: what every kernel's rate is compared with."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from sonarmap.kernels.device.device import Device
from sonarmap.tools.lab.bench.timing import timed

# On PoCL it outruns the driver's own copy, which uses one core.
_SOURCE = """
__kernel void copy(__global const float4* const restrict from, __global float4* const restrict to) {
    to[get_global_id(0)] = from[get_global_id(0)];
}
"""
_LANES, _GROUP = 4, 256
MAX_BYTES = 2**27  # of the array that is copied, far more than any cache


def copier(device: Device, source: np.ndarray) -> Callable[[], Any]:
    """A call that copies a float32 array from the device to the device, and returns the copy.

    Args:
        source: float32 of any shape whose size is a multiple of 1024.
    """
    kernel = _kernel(device)
    given, copy = device.to_device(source), device.empty(source.shape)

    def run() -> Any:
        kernel(device.queue, (source.size // _LANES,), (_GROUP,), given.data, copy.data)
        return copy

    return run


def measure_copy_rate(device: Device, repeats: int) -> list[float]:
    """The rates of some copies, reads and writes counted both [bytes/s]."""
    limit = min(MAX_BYTES, device.cl_device.max_mem_alloc_size, device.cl_device.global_mem_size // 8)
    size = 2 ** (int(limit).bit_length() - 1)
    copy = copier(device, np.ones(size // 4, np.float32))

    def run() -> None:
        copy()
        device.queue.finish()

    run()
    return [2 * size / timed(run)[0] for _ in range(repeats)]


@lru_cache(maxsize=1)
def _kernel(device: Device) -> Any:
    return device.build(_SOURCE, name="copy").copy
