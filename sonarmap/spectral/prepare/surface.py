"""The surface that a scan shows: a point for each occupied voxel, on the plane of its neighbors, with its normal."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from sonarmap.kernels.device.arrays import Pending, Readback
from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.surface.cells import Cells, Elements, fit_planes, sort_into_cells

_FARTHEST = 3.0  # a point farther than this from its neighbors' plane is no point of it, and stays [voxels]
# At a rim the neighbors lie to one side: their middle is farther away than this share of their spread. On a straight
# rim it is three quarters, well inside a fifth.
_ASIDE = 0.4
_RIM_WIDTH = 3.0  # points that have enough of a rim nearer than this lie near it [voxels]
_RIM_POINTS = 3  # which are enough
_TIMES = 3  # how often a surface is smoothed further
_RARE = 0.05  # a direction of normals that holds a smaller share of the points counts less than the others


def _hemisphere(count: int) -> np.ndarray:
    """(count, 3) unit vectors of z above 0, about evenly apart: a spiral of golden angles."""
    k = np.arange(count)
    z = (k + 0.5) / count
    angle = k * np.pi * (3 - np.sqrt(5))
    return np.column_stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z])


# Normals are counted by the nearest of these, of either sign: some 25 degrees apart.
_DIRECTIONS = _hemisphere(26)


@dataclass(frozen=True, slots=True)
class Surface:
    """Points and normals of one scan, about its grid's center, on the device that prepared it."""

    rows: np.ndarray  # (m, 12) float32, as `elements` has them on the device; `points`, `normals` and so on are columns
    elements: Elements  # the same on the device, to search among
    # device (d,) float32, of mean 1 over the points: what a point counts by the direction that its normal is nearest
    # to. The less of the surface faces that direction, the more it counts: on a wide bed a few walls fix where a scan
    # lies.
    direction_weights: Array

    @property
    def points(self) -> np.ndarray:
        """(m, 3) float32 [voxels]."""
        return self.rows[:, :3]

    @property
    def inner(self) -> np.ndarray:
        """(m,) bool, which have neighbors on all sides; the others lie at a rim of what the scan shows."""
        return self.rows[:, 3] > 0

    @property
    def normals(self) -> np.ndarray:
        """(m, 3) float32, unit, of either sign."""
        return self.rows[:, 4:7]

    @property
    def rays(self) -> np.ndarray:
        """(m, 3) float32, to each point from where the sensor saw it [voxels]; 0 where that is not known."""
        return self.rows[:, 8:11]


def smoothed_further(device: Device, surface: Surface) -> list[Surface]:
    """The surface smoothed thrice more, twice and once, with all points near a rim counted among the rim's.

    What noise moves along the beams leaves at the end of a view a slope that belongs to the sensor, not to the scene.
    """
    rim, near = surface.points[~surface.inner], np.zeros(len(surface.rows), bool)
    if len(rim) >= _RIM_POINTS:
        distances, _ = KDTree(rim).query(surface.points, _RIM_POINTS, distance_upper_bound=_RIM_WIDTH)
        near = np.isfinite(distances[:, -1])
    surfaces: list[Surface] = []
    for _ in range(_TIMES):
        smooth = smooth_surface(device, (surfaces[-1] if surfaces else surface).elements.cells).read()
        rows = smooth.rows.copy()
        rows[near, 3], rows[:, 8:11] = 0.0, surface.rays
        elements = replace(smooth.elements, rows=device.to_device(rows))
        surfaces.append(replace(smooth, rows=rows, elements=elements))
    return surfaces[::-1]


def smooth_surface(device: Device, cells: Cells, viewpoints: Sequence[np.ndarray] = ()) -> Pending[Surface]:
    """Queue a scan's points, one a voxel, at least 3, to be moved along the normal onto the plane of their neighbors.

    Noise along the beams stands out of the surface; registered as it is, it draws the scans together or apart. The
    sensor saw each point from the nearest of the viewpoints, (3,) each [voxels].
    """
    places = np.array(viewpoints, np.float64).reshape(-1, 3)
    smooth = fit_planes(device, cells, _DIRECTIONS, places, farthest=_FARTHEST, aside=_ASIDE)
    rows = Readback(device, smooth)
    return Pending(lambda: _surface(device, smooth, rows.read()))


def _surface(device: Device, smooth: Array, rows: np.ndarray) -> Surface:
    """The surface of points (m, 12) on the device, and the same on the host."""
    share = np.bincount(rows[:, 7].astype(np.int64), minlength=len(_DIRECTIONS)) / len(rows)
    weights = 1.0 / (share + _RARE)
    weights /= share @ weights
    elements = Elements(smooth, sort_into_cells(device, rows[:, :3]))
    return Surface(rows, elements, device.to_device(weights.astype(np.float32)))
