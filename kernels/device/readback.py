# pyright: strict, reportUnknownMemberType=false
"""Numbers on their way to the host: several are queued, then one wait brings all."""

from typing import Any

import numpy as np
import pyopencl as cl
import pyopencl.array as cla

from kernels.device.device import Device
from kernels.device.launch import memory_of


class Readback:
    """The copy of a device array, as what is queued before it leaves it."""

    def __init__(self, device: Device, array: cla.Array) -> None:
        """Queue the copy; the array may be used again by what is queued after it.

        Raises:
            DeviceError: the device has no memory left.
        """
        self._host: np.ndarray[Any, Any] = np.empty(array.shape, array.dtype)
        self._event: cl.Event | None = None
        if array.nbytes:
            with device.explain_full_memory():
                self._event = cl.enqueue_copy(
                    device.queue, self._host, memory_of(array), src_offset=array.offset, is_blocking=False
                )

    def get(self) -> np.ndarray[Any, Any]:
        """The array; waits only where it is not there yet, so that who reads the last one first waits once."""
        if self._event is not None:
            if self._event.command_execution_status != cl.command_execution_status.COMPLETE:
                self._event.wait()
            self._event = None
        return self._host
