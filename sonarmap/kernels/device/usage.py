# pyright: strict
"""Count the bytes that a device's arrays take: now, at most, and by whom. Off until it is asked for, and then cheap."""

import sys
import weakref
from collections import Counter
from pathlib import Path

import pyopencl as cl

from sonarmap.kernels.device.device import Device

_OWN = (str(Path(__file__).parent), str(Path(cl.__file__).parent))


class MemoryUsage:
    """What is allocated on one device from now on.

    Attributes:
        now, most: all arrays together, now and at most [bytes].
        largest: the largest single array [bytes].
        at_most: where the arrays that made up `most` were allocated, "file.py:line" -> bytes.
    """

    def __init__(self, device: Device) -> None:
        """Begin to count; arrays that are there already do not count."""
        self.now = self.most = self.largest = 0
        self.at_most: dict[str, int] = {}
        self._sites: Counter[str] = Counter()
        self._context = device.context
        device.allocator = self._allocate

    def restart(self) -> None:
        """Count the most anew, from what is allocated now."""
        self.most, self.largest, self.at_most = self.now, 0, dict(self._sites)

    def table(self, least: int = 1) -> str:
        """The arrays that made up the most, the largest first, for a message; those below `least` bytes left out."""
        sites = sorted(self.at_most.items(), key=lambda site: -site[1])
        return "\n".join(f"{size:>14,} {site}" for site, size in sites if size >= least)

    def _allocate(self, size: int) -> cl.Buffer:
        buffer = _Watched(self._context, cl.mem_flags.READ_WRITE, size)
        site = _site()
        self.now += size
        self._sites[site] += size
        self.largest = max(self.largest, size)
        if self.now > self.most:
            self.most, self.at_most = self.now, {name: held for name, held in self._sites.items() if held}
        weakref.finalize(buffer, self._free, size, site)
        return buffer

    def _free(self, size: int, site: str) -> None:
        self.now -= size
        self._sites[site] -= size


class _Watched(cl.Buffer):
    """A buffer that can be watched until it is gone."""


def _site() -> str:
    """The line outside kernels/device and PyOpenCL that asked for memory."""
    frame = sys._getframe(1)  # pyright: ignore[reportPrivateUsage]
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_OWN):
        frame = frame.f_back
    path = Path(frame.f_code.co_filename)
    return f"{path.parent.name}/{path.name}:{frame.f_lineno}"
