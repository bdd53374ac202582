"""Count what a device is asked to do: launches, their time and arrays, waits of the host, and the bytes of its arrays.

A trace puts itself before PyOpenCL's functions while a block runs, for measurements; outside of one nothing is
counted, and nothing costs.
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
    reads: int = 0  # how often the host waited: blocking reads and maps, events and queues waited for
    writes: int = 0  # transfers from the host
    # of each launch every array that it was given, once: all of them, also where it needs a part only
    array_bytes: int = 0
    # of the launches, by kernel; their times are known if the device notes them
    events: list[tuple[str, Any]] = field(default_factory=list)

    def kernel_seconds(self) -> dict[str, float]:
        """The device's time by kernel, once the work is finished [s]; nothing where the queue notes none."""
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
    """Count all that is asked of a device's queue while the block runs, in the `counts` of the moment."""
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
    """What is called before PyOpenCL's functions, each of which it is given first."""

    def __init__(self, device: Device, counts: Callable[[], Counts]) -> None:
        self._device, self._counts = device, counts
        self._passed: list[int] = []  # sizes of the arrays that went to kernels since the last launch
        self._last = 0

    def launched(self, original: Callable[..., Any], queue: Any, kernel: Any, *rest: Any, **options: Any) -> Any:
        event = original(queue, kernel, *rest, **options)
        if self._is_ours(queue):
            # several launches may share the arguments that were set once
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
        if self._is_ours(of.queue) and of.allocator is None:  # else it is copied, and counts there
            self._counts().writes += 1
        return original(of, host)

    def _is_ours(self, queue: Any) -> bool:
        return queue.int_ptr == self._device.queue.int_ptr


def everywhere(function: Callable[..., Any]) -> list[tuple[Any, str]]:
    """Every module of this project that knows a function, and under which name."""
    rooms = {"kernels", "spectral", "slam", "tools", function.__module__.partition(".")[0]}
    modules = [module for name, module in list(sys.modules.items()) if name.partition(".")[0] in rooms]
    return [(module, name) for module in modules for name, value in list(vars(module).items()) if value is function]


@contextmanager
def _before(owner: Any, name: str, instead: Callable[..., Any]) -> Iterator[None]:
    """Have `instead` called in place of a function, which it is given first."""
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
    """What is allocated on one device from now on.

    Attributes:
        now, most: all arrays together, now and at most [bytes].
        largest: the largest single array [bytes].
    """

    def __init__(self, device: Device) -> None:
        """Begin to count; arrays that are there already do not count."""
        self.now = self.most = self.largest = 0
        self._context = device.context
        device.allocator = self._allocate

    def restart(self) -> None:
        """Count the most anew, from what is allocated now."""
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
    """A buffer that can be watched until it is gone."""
