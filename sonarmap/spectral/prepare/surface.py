"""The surface of a scan: a point for each occupied voxel, moved onto the plane of its neighbors, with a normal."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from sonarmap.kernels.device.arrays import Pending, Readback
from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.surface.cells import Cells, Elements, fit_planes, sort_into_cells

_FARTHEST = 3.0  # a point farther than this from its neighbors' plane is not moved onto it [voxels]
# A point is at a rim if the mean of its neighbors is farther away than this share of their spread: that ratio is three
# quarters at a straight rim, a fifth well inside.
_ASIDE = 0.4
_RIM_WIDTH = 3.0  # a point is near a rim if there are enough rim points within this distance [voxels]
_RIM_POINTS = 3  # enough rim points
_TIMES = 3  # number of further smoothings
_RARE = 0.05  # directions of normals with a smaller share of the points get less weight


def _hemisphere(count: int) -> np.ndarray:
    """(count, 3) unit vectors with z above 0, about evenly spaced on a golden-angle spiral."""
    k = np.arange(count)
    z = (k + 0.5) / count
    angle = k * np.pi * (3 - np.sqrt(5))
    return np.column_stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z])


# Directions that normals are binned by, with either sign, about 25 degrees apart.
_DIRECTIONS = _hemisphere(26)


@dataclass(frozen=True)
class Surface:
    """Points and normals of one scan, about its grid's center, on host and device."""

    rows: np.ndarray  # (m, 12) float32, rows of `elements`; `points`, `normals` and the others are columns
    elements: Elements  # the rows on the device, sorted for search
    # device (d,) float32, weights of points by the direction nearest to their normal, of mean 1 over the points.
    # Rare directions have large weights: on a wide bed a few walls fix the position of a scan.
    direction_weights: Array

    @property
    def points(self) -> np.ndarray:
        """(m, 3) float32 [voxels]."""
        return self.rows[:, :3]

    @cached_property
    def lever(self) -> float:
        """Root mean square distance of the points from the grid's center [voxels]."""
        return float(np.sqrt((self.points**2).sum(axis=1).mean()))

    @property
    def inner(self) -> np.ndarray:
        """(m,) bool, whether a point has neighbors on all sides; other points are at a rim of the scan."""
        return self.rows[:, 3] > 0

    @property
    def normals(self) -> np.ndarray:
        """(m, 3) float32 unit normals, of either sign."""
        return self.rows[:, 4:7]

    @cached_property
    def usual_normal(self) -> tuple[np.ndarray, float]:
        """Direction of the largest mean square of the normals, toward the sensor if known, and this mean square."""
        normals = self.normals.astype(np.float64)
        squares, axes = np.linalg.eigh(normals.T @ normals / len(normals))
        away = self.rays.sum(axis=0) @ axes[:, 2] > 0
        return (-axes[:, 2] if away else axes[:, 2]), float(squares[2])

    @property
    def rays(self) -> np.ndarray:
        """(m, 3) float32, vectors from the sensor to each point [voxels]; 0 if the viewpoint is unknown."""
        return self.rows[:, 8:11]


def smoothed_further(device: Device, surface: Surface) -> list[Surface]:
    """The surface smoothed three times, twice and once more, with all points near a rim marked as rim points.

    Noise along the beams makes a slope at the edge of a view that belongs to the sensor, not to the scene.
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
    """Queue the smoothing of at least 3 points, one per voxel: each moves along the normal to its neighbors' plane.

    Without smoothing, noise along the beams pulls scans together or apart in the registration. Each point is taken to
    be seen from the nearest of the viewpoints, (3,) each [voxels].
    """
    places = np.array(viewpoints, np.float64).reshape(-1, 3)
    smooth = fit_planes(device, cells, _DIRECTIONS, places, farthest=_FARTHEST, aside=_ASIDE)
    rows = Readback(device, smooth)
    return Pending(lambda: _surface(device, smooth, rows.read()))


def _surface(device: Device, smooth: Array, rows: np.ndarray) -> Surface:
    """The surface from its rows (m, 12), on the device and on the host."""
    share = np.bincount(rows[:, 7].astype(np.int64), minlength=len(_DIRECTIONS)) / len(rows)
    weights = 1.0 / (share + _RARE)
    weights /= share @ weights
    elements = Elements(smooth, sort_into_cells(device, rows[:, :3]))
    return Surface(rows, elements, device.to_device(weights.astype(np.float32)))
