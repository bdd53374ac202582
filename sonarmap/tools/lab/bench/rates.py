"""How fast the device copies, reads, writes and changes memory in place: what every kernel's rate is held against."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from sonarmap.kernels.device.device import Device
from sonarmap.tools.lab.bench.timing import timed


@dataclass(frozen=True, slots=True)
class Traffic:
    """Bytes that an algorithm must move, valid elements only, at least once each."""

    reads: float = 0  # of arrays that are only read
    # of arrays that are only written. The lines that a processor fetches before it writes them do not count.
    writes: float = 0
    in_place: float = 0  # of arrays that are changed where they are, reading and writing counted each

    @property
    def moved(self) -> int:
        """All of it [bytes]."""
        return round(self.reads + self.writes + self.in_place)

    @property
    def touched(self) -> float:
        """Of all arrays [bytes]."""
        return self.reads + self.writes + self.in_place / 2


Access = Literal["copy", "in_place", "read", "fill"]
ACCESSES: tuple[Access, ...] = ("copy", "in_place", "read", "fill")

_LANES, _GROUP = 4, 256
# Plain enough that memory is all they wait for; on PoCL the copy outruns the driver's own, which uses one core.
_SOURCE = """
__kernel void copy(__global const float4* const restrict from, __global float4* const restrict to) {
    to[get_global_id(0)] = from[get_global_id(0)];
}

__kernel void in_place(__global float4* const restrict x, const float factor) {
    x[get_global_id(0)] *= factor;
}

__kernel void fill(__global float4* const restrict x, const float value) {
    x[get_global_id(0)] = value;
}

// COUNT vectors an item: neighbors in memory where an item has a core for itself, else neighbors of other items'
__kernel void read(__global const float16* const restrict x, __global float* const restrict sums) {
    const size_t item = get_global_id(0);
    const size_t first = FOLLOWING ? item * COUNT : item, step = FOLLOWING ? 1 : get_global_size(0);
    float16 a = 0, b = 0, c = 0, d = 0;
    for (size_t k = 0; k < COUNT; k += 4) {
        a += x[first + k * step];
        b += x[first + (k + 1) * step];
        c += x[first + (k + 2) * step];
        d += x[first + (k + 3) * step];
    }
    a += b + c + d;
    const float8 half_sum = a.lo + a.hi;
    const float4 quarter = half_sum.lo + half_sum.hi;
    sums[item] = quarter.x + quarter.y + quarter.z + quarter.w;
}
"""
_FLOPS_SOURCE = """
__kernel void multiply_add(__global float16* const restrict x, const float factor) {
    float16 a = x[get_global_id(0)], b = a + 1, c = a + 2, d = a + 3, e = a + 4, f = a + 5, g = a + 6, h = a + 7;
    for (int k = 0; k < 512; ++k) {
        a = fma(a, factor, 1.0f); b = fma(b, factor, 1.0f); c = fma(c, factor, 1.0f); d = fma(d, factor, 1.0f);
        e = fma(e, factor, 1.0f); f = fma(f, factor, 1.0f); g = fma(g, factor, 1.0f); h = fma(h, factor, 1.0f);
    }
    x[get_global_id(0)] = a + b + c + d + e + f + g + h;
}
"""
_CHAINS, _TURNS, _WIDE = 8, 512, 16
# From what a core's cache holds to far more than any cache.
_SMALLEST, _LARGEST = 2**18, 2**28
# A run of so many bytes, repeated for smaller arrays, so that a clock can see it.
_TOUCHED = 2**23


@dataclass(frozen=True, slots=True)
class Rates:
    """What the device's memory gives, by the bytes that are touched in all: caches give more than memory.

    A copy and a fill also fetch the lines that they write, on most processors, which is not counted: that is why what
    works in place has a rate of its own, and may be up to half as fast again.
    """

    # by access, by bytes touched, the highest rate seen; reads and writes both count [bytes/s]
    best: Mapping[str, Mapping[int, float]]
    copy_rate: float  # the median rate of copying what no cache holds [bytes/s]
    flops: float  # multiply-adds in registers, each two operations [1/s]

    def at(self, access: Access, touched: float) -> float:
        """The highest rate over arrays of about these bytes or more [bytes/s]."""
        rates = self.best[access]
        large = [rate for size, rate in rates.items() if size >= touched / 2]
        return max(large) if large else rates[max(rates)]

    def least_seconds(self, traffic: Traffic) -> float:
        """How long the device's memory takes for a kernel's traffic, each part in its own way [s]."""
        copied = min(traffic.reads, traffic.writes)
        parts: dict[Access, float] = {
            "copy": 2 * copied,
            "in_place": traffic.in_place,
            "read": traffic.reads - copied,
            "fill": traffic.writes - copied,
        }
        return sum(size / self.at(access, traffic.touched) for access, size in parts.items() if size)


def measure_rates(device: Device, repeats: int) -> dict[str, dict[int, list[float]]]:
    """The rates of each access at sizes from a cache's to memory's, several of each [bytes/s]."""
    most = min(_LARGEST, device.cl_device.max_mem_alloc_size, device.cl_device.global_mem_size // 4)
    sizes = [2**k for k in range(_SMALLEST.bit_length() - 1, int(most).bit_length())]
    rates: dict[str, dict[int, list[float]]] = {access: {} for access in ACCESSES}
    for size in sizes:
        for access in ACCESSES:
            rates[access][size] = _measure(device, access, size, repeats)
    return rates


def summarize_rates(device: Device, measured: Iterable[dict[str, dict[int, list[float]]]]) -> Rates:
    """The rates of several measurements, and how fast the device computes."""
    measured = list(measured)
    best = {
        access: {size: max(max(m[access][size]) for m in measured) for size in measured[0][access]}
        for access in ACCESSES
    }
    largest = max(best["copy"])
    copying = [rate for m in measured for rate in m["copy"][largest]]
    return Rates(best, float(np.median(copying)), _measure_flops(device))


def copier(device: Device, source: np.ndarray) -> Callable[[], Any]:
    """A call that copies a float32 array from the device to the device, and returns the copy.

    Args:
        source: float32 of any shape whose size is a multiple of 1024.
    """
    kernel = _kernels(device)["copy"]
    given, copy = device.to_device(source), device.empty(source.shape)

    def run() -> Any:
        kernel(device.queue, (source.size // _LANES,), (_GROUP,), given.data, copy.data)
        return copy

    return run


def _measure(device: Device, access: Access, touched: int, repeats: int) -> list[float]:
    """The rates of some runs, each of at least _TOUCHED bytes; `touched` is of both arrays of a copy."""
    kernel, again = _kernels(device)[access], max(1, _TOUCHED // touched)
    size = touched // 2 if access == "copy" else touched
    array = device.to_device(np.ones(size // 4, np.float32))
    count, one, group = size // 4 // _LANES, np.float32(1), (_GROUP,)
    arguments: list[Any] = [array.data, one]
    if access == "copy":
        arguments = [array.data, device.empty(array.shape).data]
    elif access == "read":
        count, group = size // 64 // _per_item(device), ((1,) if device.is_cpu else None)
        arguments = [array.data, device.empty((count,)).data]

    def run() -> None:
        for _ in range(again):
            kernel(device.queue, (count,), group, *arguments)
        device.queue.finish()

    run()
    moved = again * (2 * size if access in ("copy", "in_place") else size)
    return [moved / timed(run)[0] for _ in range(repeats)]


def _measure_flops(device: Device) -> float:
    kernel: Any = device.build(_FLOPS_SOURCE, name="multiply_add").multiply_add
    items = 2**12 if device.is_cpu else 2**20
    array = device.to_device(np.ones(items * _WIDE, np.float32))

    def run() -> None:
        kernel(device.queue, (items,), (64,), array.data, np.float32(0.5))
        device.queue.finish()

    run()
    return 2.0 * items * _WIDE * _CHAINS * _TURNS / min(timed(run)[0] for _ in range(5))


def _per_item(device: Device) -> int:
    return 256 if device.is_cpu else 8


@lru_cache(maxsize=1)
def _kernels(device: Device) -> dict[str, Any]:
    options = (f"-DCOUNT={_per_item(device)}", f"-DFOLLOWING={int(device.is_cpu)}")
    program = device.build(_SOURCE, options, name="rates")
    return {access: getattr(program, access) for access in ACCESSES}
