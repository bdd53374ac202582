"""How fast the device copies memory: what every kernel's rate is held against."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from kernels.device.device import Device
from tools.bench.timing import timed

_LANES, _GROUP = 4, 256
# Plain enough that memory is all it waits for; on PoCL it outruns the driver's own copy, which uses one core.
_SOURCE = """
__kernel void copy(__global const float4* const restrict from, __global float4* const restrict to) {
    to[get_global_id(0)] = from[get_global_id(0)];
}
"""
# Far more than a cache holds.
_BYTES = 2**28


def copier(device: Device, source: np.ndarray) -> tuple[Callable[[], None], Callable[[], np.ndarray]]:
    """A call that copies a float32 array from the device to the device, and one that reads the copy.

    Args:
        source: float32 of any shape whose size is a multiple of 1024.
    """
    kernel = _kernel(device)
    given, copy = device.to_device(source), device.empty(source.shape)

    def run() -> None:
        kernel(device.queue, (source.size // _LANES,), (_GROUP,), given.data, copy.data)

    return run, copy.get


@lru_cache(maxsize=1)
def _kernel(device: Device) -> Any:
    return device.build(_SOURCE, name="copy").copy


def measure_copy(device: Device, repeats: int) -> list[float]:
    """The rates of several copies of a large array, reads and writes both counted [bytes/s]."""
    size = min(_BYTES, device.cl_device.max_mem_alloc_size, device.cl_device.global_mem_size // 4)
    source = np.ones(size // 4096 * 1024, np.float32)
    run, _ = copier(device, source)

    def finished() -> None:
        run()
        device.queue.finish()

    finished()
    return [2 * source.nbytes / timed(finished)[0] for _ in range(repeats)]
