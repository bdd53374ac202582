"""Horizontal cells in which several lines have soundings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sonarmap.kernels.errors import InputError
from sonarmap.slam.map.cell import cell_keys, neighbors
from sonarmap.slam.pings.line import PingLine

_SOUNDINGS_PER_CELL = 16.0  # of a line, about
_MIN_WIDTH = 2.0  # of a cell [spacings of soundings]
_MIN_SOUNDINGS = 5  # of a line in a cell
_SLOPE_CELLS = 1
_MIN_ASPECT = 1e-3  # (smaller extent / larger)^2 of soundings that show a slope; soundings along a line show none


@dataclass(frozen=True, slots=True)
class Overlaps:
    """Cells in which several lines have a patch: their soundings there. Patches ascend by cell, and in a cell by line.

    Attributes:
        cell: edge of the cells [m].
        centers: (C, 2) mean place of the patches in each cell, East and North [m].
        slopes: (C, 2) dz/dEast and dz/dNorth of a cell and those of the eight around it, common to the lines.
        slope_noise: (C,) standard deviations of slopes in their least certain direction, without a unit.
        cells, lines: (Q,) int64, the cell and the line of each patch.
        heights: (Q,) Up of the patch at its cell's center, by the cell's own slope [m].
        variances: (Q,) variances of heights by the soundings' scatter about this slope [m^2].
        columns: (Q, E) means of further values of the soundings.
    """

    cell: float
    centers: np.ndarray
    slopes: np.ndarray
    slope_noise: np.ndarray
    cells: np.ndarray
    lines: np.ndarray
    heights: np.ndarray
    variances: np.ndarray
    columns: np.ndarray

    @classmethod
    def of(cls, points: Sequence[np.ndarray], columns: Sequence[np.ndarray], cell: float) -> "Overlaps":
        """Overlaps of lines with these (N, 3) world points [m] and (N, E) further values, in cells of `cell` [m].

        Slopes are fitted to the departures of each patch's soundings from their mean, so that navigation errors between
        lines do not change them.
        """
        xyz, values = np.concatenate(points), np.concatenate(columns)
        line = np.repeat(np.arange(len(points)), [len(of_line) for of_line in points])
        chosen = _shared(xyz, line, cell)
        xyz, values = xyz[chosen], values[chosen]
        keys, cell_of = np.unique(_keys(xyz, cell), return_inverse=True)
        names, patch, counts = np.unique(cell_of * len(points) + line[chosen], return_inverse=True, return_counts=True)
        cells, lines = np.divmod(names, len(points))
        of_patch, of_cell = members(patch, len(names)), members(cells, len(keys))
        means, means_of_values = (of_patch @ xyz) / counts[:, None], (of_patch @ values) / counts[:, None]
        off = xyz - means[patch]
        moments = of_cell @ of_patch @ (off[:, :, None] * off[:, None, :]).reshape(-1, 9)
        slopes, scatter, _ = _planes(moments, of_cell @ (counts - 1))
        centers = (of_cell @ means[:, :2]) / np.bincount(cells)[:, None]
        heights = means[:, 2] - ((means[:, :2] - centers[cells]) * slopes[cells]).sum(axis=1)
        near = neighbors(np.floor(centers / cell))
        wide_slopes, _, noise = _planes(near @ moments, near @ of_cell @ (counts - 1))
        variances = scatter[cells] / counts
        return cls(cell, centers, wide_slopes, noise, cells, lines, heights, variances, means_of_values)

    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the patches of every two lines in a cell, two arrays, the lower line number first."""
        first, second = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for step in range(1, len(self.cells)):
            same = np.flatnonzero(self.cells[step:] == self.cells[:-step])
            if not len(same):
                break
            first.append(same)
            second.append(same + step)
        return np.concatenate(first), np.concatenate(second)


def checked_cell(cell: float | None, lines: Sequence[PingLine]) -> float:
    """The given edge of cells [m]; for None, an edge with about 16 soundings of a line per cell, by the distances of
    pings and of soundings in a ping (the upper quartile, as lines overlap at their edges, where soundings are sparse).

    Raises:
        InputError: an edge that is not above 0, no lines, or none with two soundings at different places.
    """
    if not lines:
        raise InputError("no lines are given; wanted one or more")
    if cell is not None:
        if not 0 < cell < np.inf:
            raise InputError(f"`cell` is {cell} m; wanted a number above 0, or None to choose it by the soundings")
        return cell
    edges: list[float] = []
    for line in lines:
        along = np.linalg.norm(np.diff(line.places[np.unique(line.pings), :2], axis=0), axis=1)
        across = np.linalg.norm(np.diff(line.points[:, :2], axis=0), axis=1)[np.diff(line.pings) == 0]
        if len(along) and len(across):
            a, b = float(np.median(along)), float(np.percentile(across, 75))
            edges.append(max(np.sqrt(_SOUNDINGS_PER_CELL * a * b), _MIN_WIDTH * a, _MIN_WIDTH * b))
    edge = float(np.median(edges)) if edges else 0.0
    if edge <= 0:
        raise InputError(f"{len(lines)} lines have no distances between soundings; give `cell`, the edge of cells [m]")
    return edge


def members(groups: np.ndarray, count: int) -> csr_array:
    """(count, n) matrix that sums rows by their group (n,)."""
    n = len(groups)
    return csr_array((np.ones(n), (groups, np.arange(n))), shape=(count, n))


def _keys(points: np.ndarray, cell: float) -> np.ndarray:
    return cell_keys(points * [1, 1, 0], cell, np.zeros(3))[0]


def _shared(points: np.ndarray, lines: np.ndarray, cell: float) -> np.ndarray:
    """(N,) bool: soundings (N, 3) [m] in cells where two lines or more have enough of them; `lines` (N,)."""
    cells = np.unique(_keys(points, cell), return_inverse=True)[1]
    count = int(lines.max(initial=0)) + 1
    names, patch, counts = np.unique(cells * count + lines, return_inverse=True, return_counts=True)
    enough = counts >= _MIN_SOUNDINGS
    several = np.bincount((names // count)[enough], minlength=int(cells.max(initial=0)) + 1) > 1
    return enough[patch] & several[cells]


def _planes(moments: np.ndarray, freedom: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(C, 2) slopes of planes by least squares, (C,) variances of soundings about them [m^2], and (C,) standard
    deviations of the slopes; `moments` (C, 9) are sums of the soundings' products about their means [m^2], with
    `freedom` (C,) degrees of freedom."""
    moments = moments.reshape(-1, 3, 3)
    inverse = np.linalg.pinv(moments[:, :2, :2], rcond=_MIN_ASPECT, hermitian=True)
    slopes = np.einsum("cij,cj->ci", inverse, moments[:, :2, 2])
    scatter = np.maximum(moments[:, 2, 2] - (slopes * moments[:, :2, 2]).sum(axis=1), 0) / (freedom - 2)
    if len(scatter):  # a few soundings lie in a plane by chance
        scatter = np.maximum(scatter, np.median(scatter))
    return slopes, scatter, np.sqrt(scatter * np.linalg.norm(inverse, 2, axis=(1, 2)))
