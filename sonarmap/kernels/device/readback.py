"""Results on their way to the host while it does other work: several are queued, then one wait brings all."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
import pyopencl as cl
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import memory_of

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Pending(Generic[T]):
    """What a kernel that is queued will say; `read` waits for it, if it is not there yet."""

    read: Callable[[], T]


class Readback:
    """The copy of a device array, as what is queued before it leaves it."""

    def __init__(self, device: Device, array: cla.Array) -> None:
        """Queue the copy, without waiting; the array may be used again by what is queued after it."""
        self._host: np.ndarray[Any, Any] = np.empty(array.shape, array.dtype)
        self._array = array  # whose memory must not go to another one before
        self._copied: cl.Event | None = None
        if array.nbytes:
            with device.explain_full_memory():
                self._copied = cl.enqueue_copy(
                    device.queue, self._host, memory_of(array), src_offset=array.offset, is_blocking=False
                )
                device.queue.flush()

    def read(self) -> np.ndarray[Any, Any]:
        """The array; waits only where it is not there yet, so that who reads the last one first waits once."""
        if self._copied is not None:
            if self._copied.command_execution_status != cl.command_execution_status.COMPLETE:
                self._copied.wait()
            self._copied = None
        return self._host
