"""Count a device's kernel launches, their times and arrays, the host's waits, and the memory of arrays.

`tracing` wraps PyOpenCL's functions while a block runs, for measurements; elsewhere nothing is counted or slowed down.
"""

import sys
import weakref
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import wraps
from typing import Any

import numpy as np
import pyopencl as cl
import pyopencl._cl as binding
import pyopencl.array as cla

from sonarmap.kernels.device import launch
from sonarmap.kernels.device.device import Device


@dataclass(slots=True)
class Counts:
    launches: int = 0  # kernels
    reads: int = 0  # waits of the host: for blocking reads and maps, for events and for queues
    writes: int = 0  # transfers from the host
    # total size of the array arguments of all launches, in full even where a kernel uses a part of an array
    array_bytes: int = 0
    # (kernel, event) of each launch; events have times if the device was opened with `profiling`
    events: list[tuple[str, Any]] = field(default_factory=list)

    def kernel_seconds(self) -> dict[str, float]:
        """Device time per kernel [s], once the work is finished; empty without `profiling`."""
        seconds: dict[str, float] = {}
        for kernel, event in self.events:
            try:
                took = 1e-9 * (event.profile.end - event.profile.start)
            except cl.Error:
                return {}
            seconds[kernel] = seconds.get(kernel, 0.0) + took
        return seconds


@contextmanager
def tracing(device: Device, counts: Callable[[], Counts]) -> Iterator[None]:
    """Count what a device's queue does while the block runs, in what `counts` returns at that time."""
    tracer = _Tracer(device, counts)
    with ExitStack() as stack:
        for owner in (cl, binding):
            stack.enter_context(_before(owner, "enqueue_nd_range_kernel", tracer.launched))
        stack.enter_context(_before(cl, "enqueue_copy", tracer.copied))
        stack.enter_context(_before(cl, "enqueue_map_buffer", tracer.mapped))
        stack.enter_context(_before(cl, "wait_for_events", tracer.waited))
        stack.enter_context(_before(cl.Event, "wait", tracer.waited))
        stack.enter_context(_before(cl.CommandQueue, "finish", tracer.waited))
        stack.enter_context(_before(Device, "to_device", tracer.uploaded))
        for owner, name in everywhere(launch.memory_of):
            stack.enter_context(_before(owner, name, tracer.took))
        yield


class _Tracer:
    """Wrappers of PyOpenCL's functions; each gets the original function as its first argument."""

    def __init__(self, device: Device, counts: Callable[[], Counts]) -> None:
        self._device, self._counts = device, counts
        self._passed: list[int] = []  # sizes of the arrays that went to kernels since the last launch
        self._last = 0

    def launched(self, original: Callable[..., Any], queue: Any, kernel: Any, *rest: Any, **options: Any) -> Any:
        event = original(queue, kernel, *rest, **options)
        if self._is_ours(queue):
            # arguments that were set once may serve several launches
            self._last = sum(self._passed) or self._last
            self._passed.clear()
            to = self._counts()
            to.launches += 1
            to.array_bytes += self._last
            to.events.append((kernel.function_name, event))
        return event

    def copied(self, original: Callable[..., Any], queue: Any, to: Any, source: Any, **options: Any) -> Any:
        if not self._is_ours(queue):
            return original(queue, to, source, **options)
        counts = self._counts()
        if not isinstance(to, cl.MemoryObjectHolder):
            counts.reads += bool(options.get("is_blocking", True))
        elif not isinstance(source, cl.MemoryObjectHolder):
            counts.writes += 1
        return original(queue, to, source, **options)

    def mapped(self, original: Callable[..., Any], queue: Any, *rest: Any, **options: Any) -> Any:
        array, event = original(queue, *rest, **options)
        if self._is_ours(queue):
            self._counts().reads += bool(options.get("is_blocking", True))
        return array, event

    def waited(self, original: Callable[..., Any], *given: Any) -> Any:
        self._counts().reads += 1
        return original(*given)

    def took(self, original: Callable[..., Any], array: cla.Array) -> Any:
        self._passed.append(array.nbytes)
        return original(array)

    def uploaded(self, original: Callable[..., Any], of: Device, host: np.ndarray) -> Any:
        if self._is_ours(of.queue) and of.allocator is None:  # else `copied` counts it
            self._counts().writes += 1
        return original(of, host)

    def _is_ours(self, queue: Any) -> bool:
        return queue.int_ptr == self._device.queue.int_ptr


def everywhere(function: Callable[..., Any]) -> list[tuple[Any, str]]:
    """(module, name) of every reference to a function in this project's modules."""
    rooms = {"kernels", "spectral", "slam", "tools", function.__module__.partition(".")[0]}
    modules = [module for name, module in list(sys.modules.items()) if name.partition(".")[0] in rooms]
    return [(module, name) for module in modules for name, value in list(vars(module).items()) if value is function]


@contextmanager
def _before(owner: Any, name: str, instead: Callable[..., Any]) -> Iterator[None]:
    """Replace a function by `instead`, which gets the original as its first argument."""
    original = getattr(owner, name)

    @wraps(original)
    def call(*given: Any, **options: Any) -> Any:
        return instead(original, *given, **options)

    setattr(owner, name, call)
    try:
        yield
    finally:
        setattr(owner, name, original)


class MemoryUsage:
    """Counter of the memory of a device's arrays.

    Attributes:
        now, most: current and largest total size of all arrays [bytes].
        largest: size of the largest array [bytes].
    """

    def __init__(self, device: Device) -> None:
        """Begin to count; existing arrays do not count."""
        self.now = self.most = self.largest = 0
        self._context = device.context
        device.allocator = self._allocate

    def restart(self) -> None:
        """Reset `most` to the current total, and `largest`."""
        self.most, self.largest = self.now, 0

    def _allocate(self, size: int) -> cl.Buffer:
        buffer = _Watched(self._context, cl.mem_flags.READ_WRITE, size)
        self.now += size
        self.largest = max(self.largest, size)
        self.most = max(self.most, self.now)
        weakref.finalize(buffer, self._free, size)
        return buffer

    def _free(self, size: int) -> None:
        self.now -= size


class _Watched(cl.Buffer):
    """A buffer that can have a weak reference."""
