# pyright: strict, reportUnknownMemberType=false
"""Read what the device computes while the host does other work."""

import numpy as np
import pyopencl as cl
import pyopencl.array as cla

from kernels.device.device import Device
from kernels.device.launch import memory_of


class Later:
    """What an array holds once all that is queued so far is done: copied to the host behind it, before what follows."""

    def __init__(self, device: Device, array: cla.Array) -> None:
        """Queue the copy; nothing waits.

        Raises:
            DeviceError: the device has no memory left.
        """
        self._host = np.empty(array.shape, array.dtype)
        self._array = array  # whose memory must not go to another one before
        with device.explain_full_memory():
            self._copied = cl.enqueue_copy(
                device.queue, self._host, memory_of(array), src_offset=array.offset, is_blocking=False
            )
            device.queue.flush()

    def get(self) -> np.ndarray:
        """The numbers; waits until they are there."""
        cl.wait_for_events([self._copied])
        return self._host
