"""Timing of interleaved calls, facts about the host, and the copy rate of a device."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any, ParamSpec, TypeVar

import numpy as np

from sonarmap.kernels.device.device import Device

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Times:
    """Median, quartiles and extremes of repeated measurements of a duration [s]."""

    count: int
    median: float
    first_quartile: float
    third_quartile: float
    least: float
    most: float


def summarize(seconds: Sequence[float]) -> Times:
    """The statistics of one or more durations [s]."""
    least, first, median, third, most = np.quantile(seconds, [0, 0.25, 0.5, 0.75, 1]).tolist()
    return Times(len(seconds), median, first, third, least, most)


def timed(call: Callable[P, T], *arguments: P.args, **options: P.kwargs) -> tuple[float, T]:
    """The wall time of a call [s], and its result."""
    start = perf_counter()
    returned = call(*arguments, **options)
    return perf_counter() - start, returned


def interleave(
    calls: Sequence[Callable[[], object]], repeats: int, restore: Callable[[], object] = lambda: None
) -> list[Times]:
    """Times of calls that take turns, so that other load of the machine affects all of them; in the order of the calls.

    A first round is not timed. `restore` is called before every round, to restore input that the calls overwrite.
    """
    rounds: list[list[float]] = []
    for _ in range(1 + repeats):
        restore()
        rounds.append([timed(call)[0] for call in calls])
    return [summarize(seconds) for seconds in zip(*rounds[1:], strict=True)]


def processor_name() -> str:
    """The host's processor; "" if the system does not name it."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")


def count_cores() -> int:
    """Number of cores that this process may use, which its CPU affinity can limit."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def load_average() -> float | None:
    """Mean number of runnable threads in the last minute, including this process; None if unknown."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None


# On PoCL it is faster than the driver's copy, which uses one core
_SOURCE = """
__kernel void copy(__global const float4* const restrict from, __global float4* const restrict to) {
    to[get_global_id(0)] = from[get_global_id(0)];
}
"""
_LANES = 4
_GROUP = 256
MAX_BYTES = 2**27  # largest size of the copied array, far more than any cache


def copier(device: Device, source: np.ndarray) -> Callable[[], Any]:
    """A function that copies `source` on the device and returns the copy; float32, its size a multiple of 1024."""
    kernel = _kernel(device)
    original, copy = device.to_device(source), device.empty(source.shape)

    def run() -> Any:
        kernel(device.queue, (source.size // _LANES,), (_GROUP,), original.data, copy.data)
        return copy

    return run


def measure_copy_rate(device: Device, repeats: int) -> list[float]:
    """The rate of each of `repeats` copies, counting both reads and writes [bytes/s]."""
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
