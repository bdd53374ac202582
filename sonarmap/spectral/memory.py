"""How much device memory a registration needs, by either method, known before anything is allocated."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import DeviceError
from sonarmap.kernels.fft.edges import EDGES

Method = Literal["spectral", "hemisphere"]

POINTS = 200_000  # of each scan
# Voxels along an edge -> MiB of a prepared scan, of all else, and of the largest array, for scans of POINTS and any
# rotation. tests/spectral/test_memory.py compares the table with what is allocated.
_EDGES = (32, 64, 128, 192, 256, 320, 384, 512)
_NEEDS: dict[Method, tuple[tuple[int, int, int], ...]] = {
    "spectral": (
        (7, 107, 40), (9, 116, 40), (30, 264, 40), (57, 363, 40), (115, 667, 68), (194, 983, 131), (309, 1448, 225),
        (677, 3078, 528),
    ),
    "hemisphere": (
        (4, 4, 2), (6, 9, 2), (25, 45, 9), (76, 147, 29), (174, 344, 68), (324, 669, 131), (540, 1150, 225),
        (1225, 2709, 528),
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class MemoryPlan:
    """What one method allocates on one grid [bytes]."""

    edge: int  # voxels along each edge of the grid
    scan: int  # one prepared scan
    scratch: int  # all that is needed beside prepared scans
    largest: int  # the largest array

    @property
    def pair(self) -> int:
        """All arrays that exist at once while a pair is prepared and registered [bytes]."""
        return 2 * self.scan + self.scratch


def memory_plan(edge: int, method: Method = "spectral") -> MemoryPlan:
    """What a method allocates on a grid of `edge` voxels along each edge, interpolated by the number of voxels."""
    voxels = np.array(_EDGES, np.float64) ** 3
    needs = [int(2**20 * np.interp(edge**3, voxels, column)) for column in np.transpose(_NEEDS[method])]
    return MemoryPlan(edge, *needs)


def memory_plans(edge: int) -> tuple[MemoryPlan, MemoryPlan]:
    """Of both methods."""
    return memory_plan(edge, "spectral"), memory_plan(edge, "hemisphere")


def require_memory(device: Device, plan: MemoryPlan) -> None:
    """Refuse a grid that the device cannot hold together with two prepared scans, and name one that it can."""
    smaller = [edge for edge in reversed(EDGES) if edge < plan.edge and edge % 8 == 0]
    fitting = next((edge for edge in smaller if _fits(device, edge)), None)
    device.require(plan.largest, plan.pair, hint=f"`edge={fitting}`" if fitting else "another device")


def largest_edge(device: Device) -> int | None:
    """The largest grid that the device can hold with two prepared scans, by either method; None where none fits."""
    return next((edge for edge in reversed(EDGES) if _fits(device, edge)), None)


def scans_that_fit(device: Device, edge: int) -> int:
    """How many prepared scans the device can hold beside what a pair needs, by the method that needs more."""
    return min(max(0, device.memory - plan.scratch) // plan.scan for plan in memory_plans(edge))


def prepared_size(edge: int) -> int:
    """What a prepared scan takes, by the method that needs more [bytes]."""
    return max(plan.scan for plan in memory_plans(edge))


def _fits(device: Device, edge: int) -> bool:
    try:
        for plan in memory_plans(edge):
            device.require(plan.largest, plan.pair, hint="")
    except DeviceError:
        return False
    return True
