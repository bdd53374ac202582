"""Count the bytes that a device's arrays take, now and at most. Off until it is asked for, and then cheap."""

import weakref

import pyopencl as cl

from sonarmap.kernels.device.device import Device


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
