"""Device memory that a registration needs by either method, known before anything is allocated."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import DeviceError
from sonarmap.kernels.fft.edges import EDGES

Method = Literal["spectral", "hemisphere"]

POINTS = 200_000  # number of points of each scan
# MiB of a prepared scan, of all else, and of the largest array, for each of _EDGES, scans of POINTS, and any rotation.
# tests/spectral/test_memory.py compares the table with the allocations.
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
    """Device memory of one method on one grid [bytes]."""

    edge: int  # voxels along each edge of the grid
    scan: int  # one prepared scan
    scratch: int  # everything but prepared scans
    largest: int  # the largest array

    @property
    def pair(self) -> int:
        """All arrays that exist at the same time while a pair is prepared and registered [bytes]."""
        return 2 * self.scan + self.scratch


def memory_plan(edge: int, method: Method = "spectral") -> MemoryPlan:
    """Plan of a method on a grid of `edge` voxels per edge, interpolated by the number of voxels."""
    voxels = np.array(_EDGES, np.float64) ** 3
    needs = [int(2**20 * np.interp(edge**3, voxels, column)) for column in np.transpose(_NEEDS[method])]
    return MemoryPlan(edge, *needs)


def memory_plans(edge: int) -> tuple[MemoryPlan, MemoryPlan]:
    """Plans of both methods."""
    return memory_plan(edge, "spectral"), memory_plan(edge, "hemisphere")


def require_memory(device: Device, plan: MemoryPlan) -> None:
    """Raise DeviceError, with the edge of a grid that fits, if a pair does not fit the device's memory."""
    smaller = [edge for edge in reversed(EDGES) if edge < plan.edge and edge % 8 == 0]
    fitting = next((edge for edge in smaller if _fits(device, edge)), None)
    device.require(plan.largest, plan.pair, hint=f"`edge={fitting}`" if fitting else "another device")


def largest_edge(device: Device) -> int | None:
    """Edge of the largest grid on which both methods fit the device with two prepared scans; None if none does."""
    return next((edge for edge in reversed(EDGES) if _fits(device, edge)), None)


def scans_that_fit(device: Device, edge: int) -> int:
    """Number of prepared scans that fit the device beside the scratch memory, by the method that needs more."""
    return min(max(0, device.memory - plan.scratch) // plan.scan for plan in memory_plans(edge))


def _fits(device: Device, edge: int) -> bool:
    try:
        for plan in memory_plans(edge):
            device.require(plan.largest, plan.pair, hint="")
    except DeviceError:
        return False
    return True
