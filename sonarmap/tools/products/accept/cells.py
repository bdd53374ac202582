"""Depths of a map in cells, with their total vertical and horizontal uncertainty (TVU, THU).

A cell's depth is that at its center, by the plane through the soundings of the cell and its neighbors. A horizontal
shift s of the soundings changes the depth of a place by the surface's slope, so a shift makes the height err by n . s
with n = (-slope_x, -slope_y, 1). The causes are independent of one another:

- poses: soundings are shifted by the errors of their scans' poses. Neighboring scans err alike: all poses have a joint
  covariance.
- correction: a lever arm or another systematic error of the fixes that the map estimated. Until it is measured, the
  whole shift by its correction counts, as of 95 %.
- datum: an error that all fixes share, as of a tide gauge or a base station. The user says it, as a map does not know.
- noise: the soundings' scatter about the plane, by the noise of ranges and the surface's roughness. The depth at the
  center is as far from the plane as theirs, so the scatter is not divided by the number of soundings.
"""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from scipy import sparse

from sonarmap.kernels.errors import InputError
from sonarmap.slam.decide.systematic import Systematic
from sonarmap.slam.map.cell import neighbors
from sonarmap.slam.map.surface import on_surface
from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.products.compare.surface import Epoch, levers

VERTICAL = 1.959964  # sigmas of a 95 % interval
# Radius of a circle that holds 95 % of a normal distribution, over its larger sigma, as a polynomial in the ratio of
# the smaller sigma to the larger (Leenhouts, Navigation 32(1), 1985; 2.45 where they are equal)
_CIRCLE = (1.960790, 0.004071, 0.114276, 0.371625)
_FEWEST = 4  # least number of the map's points in a cell and its neighbors: three define a plane
_MOST_CELLS = 100_000_000  # of the rectangle around the map
_CHUNK = 4000  # cells whose covariances are computed at a time
_LEAST_SPREAD = 1e-3  # variance that is added to that of the places of a plane's points [squared cells]


@dataclass(frozen=True)  # without slots, which cached_property needs
class DepthCells:
    """K cells with soundings, ordered by row, then column.

    Attributes:
        cell: edge [m].
        low: (2,) column and row of the lower left cell, in cells from the origin of the map's frame.
        row, column: (K,) int64, from `low`.
        depth: (K,) float64 [m], positive down.
        soundings: (K,) int64, number of sonar points.
        passes: (K,) int64, largest number of scans that saw one of the map's points in the cell.
        slope: (K, 2) float64, change of the height by East and by North.
        shift: (K, 3, 3) float64 covariance of the soundings' shift East, North and Up [m^2].
        scatter: (K,) float64 standard deviation of soundings about the plane [m].
        datum: standard deviation of the heights' zero [m].
    """

    cell: float
    low: np.ndarray
    row: np.ndarray
    column: np.ndarray
    depth: np.ndarray
    soundings: np.ndarray
    passes: np.ndarray
    slope: np.ndarray
    shift: np.ndarray
    scatter: np.ndarray
    datum: float

    @property
    def terms(self) -> dict[str, np.ndarray]:
        """Parts of the TVU by cause, (K,) [m] each, 95 %; `slope` is what horizontal shifts add to vertical ones."""
        return {name: VERTICAL * np.sqrt(np.maximum(part, 0.0)) for name, part in self._variances.items()}

    @property
    def tvu(self) -> np.ndarray:
        """(K,) total vertical uncertainty [m], 95 %."""
        return VERTICAL * np.sqrt(sum(self._variances.values()))

    @property
    def thu(self) -> np.ndarray:
        """(K,) total horizontal uncertainty [m]: radius of the circle that holds 95 %."""
        return circle_radius(np.sqrt(np.maximum(np.linalg.eigvalsh(self.shift[:, :2, :2]), 0.0)))

    @cached_property
    def _variances(self) -> dict[str, np.ndarray]:
        up = self.shift[:, 2, 2]
        normal = np.column_stack([-self.slope, np.ones(len(up))])
        across = np.einsum("ka,kab,kb->k", normal, self.shift, normal)
        return {"poses": up, "slope": across - up, "noise": self.scatter**2, "datum": np.full(len(up), self.datum**2)}


def circle_radius(sigmas: np.ndarray) -> np.ndarray:
    """(K,) radii [m] of circles that hold 95 % of normal distributions, from their sigmas (K, 2) [m] along the axes of
    their ellipses, the smaller first. Errors up to 0.2 %."""
    ratio = sigmas[:, 0] / np.maximum(sigmas[:, 1], 1e-12)
    return sigmas[:, 1] * np.polynomial.polynomial.polyval(ratio, _CIRCLE)


def depth_cells(folder: Map, cell: float, datum: tuple[float, float] = (0.0, 0.0)) -> DepthCells:
    """The cells of a map's largest part, without stray echoes.

    Args:
        cell: their edge [m].
        datum: standard deviations of errors that all fixes share: of East and of North, and of Up [m].

    Raises:
        InputError: too many cells, or none with enough soundings.
    """
    part, epoch = folder.parts[0], Epoch.of_map(folder)
    surface = on_surface(part.points, folder.voxel)
    points, weight, scan = part.points[surface], epoch.weight[surface], epoch.scan[surface]
    columns = {name: part.columns[name][surface] for name in ("seen", "count", "scan")}
    place = np.floor(points[:, :2] / cell).astype(np.int64)
    low = place.min(axis=0)
    width, height = (place.max(axis=0) - low + 1).tolist()
    if width * height > _MOST_CELLS:
        raise InputError(f"cells of {cell:g} m: more than {_MOST_CELLS:,} around the map; give larger ones with --cell")
    keys, of = np.unique((place[:, 1] - low[1]) * width + place[:, 0] - low[0], return_inverse=True)
    row, column = keys // width, keys % width
    near = neighbors(np.column_stack([column, row]))
    mean, slope, scatter, count = _planes(points, weight, of, near, cell)
    if not (kept := count >= _FEWEST).any():
        raise InputError(f"no cell of {cell:g} m has {_FEWEST} points near it; give a larger one with --cell")
    center = (np.column_stack([column, row]) + low + 0.5) * cell
    zero = 0.0 if folder.georeference is None else folder.georeference.height
    depth = -zero - mean[:, 2] - np.einsum("ka,ka->k", slope, center - mean[:, :2])
    passes = np.zeros(len(keys), np.int64)
    np.maximum.at(passes, of, columns["seen"])
    share = weight / np.bincount(of, weight)[of]
    shift = _shifts(points, share, of, scan, epoch.covariance) + datum[0] ** 2 * np.diag([1.0, 1.0, 0.0])
    moved = share[:, None] * _correction(folder, points, columns["scan"]) / VERTICAL
    moved = np.column_stack([np.bincount(of, axis) for axis in moved.T])
    shift += moved[:, :, None] * moved[:, None, :]
    soundings = np.bincount(of, columns["count"]).astype(np.int64)
    numbers = row, column, depth, soundings, passes, slope, shift, scatter
    return DepthCells(cell, low, *(number[kept] for number in numbers), datum=datum[1])


def _planes(
    points: np.ndarray, weight: np.ndarray, of: np.ndarray, near: sparse.csr_array, cell: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Planes through the points (M, 3) of the cells `of` (M,) and their neighbors, by weighted least squares.

    Returns:
        means (K, 3) of the cells' own points [m], slopes (K, 2), standard deviations (K,) of all points about the plane
        [m], and their numbers (K,).
    """
    middle = points.mean(axis=0)  # moments are of small numbers
    p, count, total = points - middle, near @ np.bincount(of), near @ np.bincount(of, weight)
    sums = np.column_stack([np.bincount(of, weight * axis) for axis in p.T])
    mean = near @ sums / total[:, None]
    moments = np.array([[near @ np.bincount(of, weight * a * b) / total for b in p.T] for a in p.T])
    moments = moments.transpose(2, 0, 1) - mean[:, :, None] * mean[:, None, :]
    flat = moments[:, :2, :2] + _LEAST_SPREAD * cell**2 * np.eye(2)  # points in one row have no slope across it
    slope = np.linalg.solve(flat, moments[:, :2, 2, None])[:, :, 0]
    normal = np.column_stack([-slope, np.ones(len(slope))])
    variance = np.maximum(np.einsum("ka,kab,kb->k", normal, moments, normal), 0.0)
    scatter = np.sqrt(variance * count / np.maximum(count - 3, 1))  # three numbers of the plane are fitted
    return sums / np.bincount(of, weight)[:, None] + middle, slope, scatter, count


def _correction(folder: Map, points: np.ndarray, scan: np.ndarray) -> np.ndarray:
    """(M, 3) how far the map's correction of a systematic error of the fixes moved points (M, 3) of scans (M,) [m]."""
    row, part = folder.summary.get("systematic"), folder.parts[0]
    if not row:
        return np.zeros_like(points)
    numbers = {each.name: row.get(each.name, 0.0) for each in fields(Systematic) if each.name != "alternative"}
    T = part.trajectory.T_world_sensor
    corrected = Systematic(**numbers).corrected(T, part.trajectory, np.arange(len(T)))
    return (corrected * T.inv())[np.searchsorted(part.scans, scan)].apply(points) - points


def _shifts(points: np.ndarray, share: np.ndarray, of: np.ndarray, scan: np.ndarray, joint: np.ndarray) -> np.ndarray:
    """(K, 3, 3) covariances of the mean shift of each cell's points by the errors of the poses, left tangents."""
    at = np.repeat(of, 6), (6 * scan[:, None] + np.arange(6)).ravel()
    lever = (share[:, None] * levers(points, np.tile(axis, (len(points), 1))) for axis in np.eye(3))
    cells = int(of.max()) + 1
    J = [sparse.csr_array((each.ravel(), at), shape=(cells, len(joint))) for each in lever]
    shift = np.empty((cells, 3, 3))
    for start in range(0, cells, _CHUNK):
        some = slice(start, start + _CHUNK)
        for a in range(3):
            weighted = J[a][some] @ joint
            for b in range(3):
                shift[some, a, b] = (J[b][some] * weighted).sum(axis=1)
    return (shift + shift.swapaxes(1, 2)) / 2
