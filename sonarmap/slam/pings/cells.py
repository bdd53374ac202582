"""Patches, the soundings of a line in a horizontal cell, and the cells in which several lines have a patch."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import PingLine

_SOUNDINGS_PER_CELL = 16.0  # of a line, about
_MIN_WIDTH = 2.0  # of a cell [spacings of soundings]
_MIN_SOUNDINGS = 5  # of a cell that has a slope
_MIN_ASPECT = 0.02  # (smaller extent / larger)^2 of soundings that show a slope; soundings along a line show none
# Weights of a cell's neighbors in its slope.
_SAME_CELL = 4.0
_EDGE_NEIGHBOR = 2.0
_CORNER_NEIGHBOR = 1.0


@dataclass(frozen=True, slots=True)
class Patches:
    """The Q patches of one line, ascending by cell.

    Attributes:
        keys: (Q,) int64 cell keys: the East index in the upper 32 bits, the North index in the lower.
        counts: (Q,) numbers of soundings.
        means: (Q, 3) means of the soundings [m]: East and North from the cell's center, and Up.
        moments: (Q, 6) sums of the soundings' products about their means [m^2]: xx, xy, yy, xz, yz, zz.
        columns: (Q, E) means of further values of the soundings.
    """

    keys: np.ndarray
    counts: np.ndarray
    means: np.ndarray
    moments: np.ndarray
    columns: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, cell: float, columns: np.ndarray) -> "Patches":
        """Patches of (N, 3) world points [m] with (N, E) columns, in cells with edges of `cell` [m]."""
        keys, patch = np.unique(keys_of(points, cell), return_inverse=True)
        counts = np.bincount(patch, minlength=len(keys)).astype(float)
        local = np.column_stack([points[:, :2] - (_indices(keys)[patch] + 0.5) * cell, points[:, 2]])
        means = _summed(local, patch, len(keys)) / counts[:, None]
        x, y, z = (local - means[patch]).T
        products = np.column_stack([x * x, x * y, y * y, x * z, y * z, z * z])
        others = _summed(columns, patch, len(keys)) / counts[:, None]
        return cls(keys, counts, means, _summed(products, patch, len(keys)), others)

    def pooled(self) -> tuple[np.ndarray, np.ndarray]:
        """(Q, 6) moments and (Q,) degrees of freedom of each patch pooled with its neighbors.

        Each patch counts about its own mean, so that navigation errors between patches do not change the slope.
        """
        moments, freedom = np.zeros_like(self.moments), np.zeros_like(self.counts)
        for east in (-1, 0, 1):
            for north in (-1, 0, 1):
                weight = (_SAME_CELL, _EDGE_NEIGHBOR, _CORNER_NEIGHBOR)[abs(east) + abs(north)]
                wanted = self.keys + (east << 32) + north
                at = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
                weights = weight * (self.keys[at] == wanted)
                moments += weights[:, None] * self.moments[at]
                freedom += weights * (self.counts[at] - 1)
        return moments, freedom


@dataclass(frozen=True, slots=True)
class Overlaps:
    """Cells in which several lines have a patch. Patches ascend by cell, and in a cell by line.

    Attributes:
        cell: edge of the cells [m].
        centers: (C, 2) cell centers, East and North [m].
        slopes: (C, 2) dz/dEast and dz/dNorth, common to the lines.
        slope_noise: (C,) standard deviations of slopes by the differences between lines, without a unit.
        cells, lines: (Q,) int64, the cell and the line of each patch.
        heights: (Q,) Up of the patch at its cell's center [m].
        variances: (Q,) variances of heights by the soundings' scatter about the slope [m^2].
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
    def of(cls, patches: Sequence[Patches], cell: float) -> "Overlaps":
        """Overlaps of the lines with these patches, one `Patches` per line."""
        pooled = [of_line.pooled() for of_line in patches]
        moments, freedom = np.concatenate([m for m, _ in pooled]), np.concatenate([f for _, f in pooled])
        keys, counts, means, columns = (
            np.concatenate([getattr(line, name) for line in patches]) for name in ("keys", "counts", "means", "columns")
        )
        lines = np.repeat(np.arange(len(patches)), [len(of_line.keys) for of_line in patches])
        enough = (counts >= _MIN_SOUNDINGS) & _wide(moments)
        several = np.unique(keys[enough], return_counts=True)
        chosen = np.flatnonzero(enough & np.isin(keys, several[0][several[1] > 1]))
        chosen = chosen[np.lexsort([lines[chosen], keys[chosen]])]
        cell_keys, cells = np.unique(keys[chosen], return_inverse=True)
        common = _summed(moments[chosen], cells, len(cell_keys))
        slopes, patch_slopes = _slopes(common), _slopes(moments[chosen])
        scatter = np.maximum(moments[chosen, 5] - (patch_slopes * moments[chosen, 3:5]).sum(axis=1), 0)
        scatter /= np.maximum(freedom[chosen], 1)
        variances = scatter / counts[chosen]
        heights = means[chosen, 2] - (slopes[cells] * means[chosen, :2]).sum(axis=1)
        mean_scatter = np.bincount(cells, weights=scatter, minlength=len(cell_keys)) / np.bincount(cells)
        if len(mean_scatter):  # a few soundings lie in a plane by chance
            mean_scatter = np.maximum(mean_scatter, np.median(mean_scatter))
        noise = _noise(patch_slopes - slopes[cells], np.sqrt(mean_scatter / _min_spread(common)), cells)
        centers = (_indices(cell_keys) + 0.5) * cell
        return cls(cell, centers, slopes, noise, cells, lines[chosen], heights, variances, columns[chosen])

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


def keys_of(points: np.ndarray, cell: float) -> np.ndarray:
    """(N,) int64 keys of the cells, with edges of `cell` [m], of (N, 3) points [m]."""
    east, north = np.floor(points[:, :2] / cell).astype(np.int64).T
    return (east << 32) + north


def _indices(keys: np.ndarray) -> np.ndarray:
    """(Q, 2) East and North indices of cells; a negative North index borrows from the upper bits."""
    north = (keys + (1 << 31)) % (1 << 32) - (1 << 31)
    return np.column_stack([(keys - north) >> 32, north])


def _summed(values: np.ndarray, groups: np.ndarray, count: int) -> np.ndarray:
    """(count, E) sums of (N, E) rows by group."""
    sums = [np.bincount(groups, weights=column, minlength=count) for column in values.T]
    return np.column_stack(sums) if sums else np.zeros((count, 0))


def _wide(moments: np.ndarray) -> np.ndarray:
    """(Q,) bool, whether a patch's soundings spread in both directions."""
    xx, xy, yy = moments.T[:3]
    return xx * yy - xy**2 > _MIN_ASPECT * (xx + yy) ** 2


def _slopes(moments: np.ndarray) -> np.ndarray:
    """(Q, 2) dz/dEast and dz/dNorth by least squares."""
    xx, xy, yy, xz, yz, _ = moments.T
    return np.column_stack([yy * xz - xy * yz, xx * yz - xy * xz]) / np.maximum(xx * yy - xy**2, 1e-300)[:, None]


def _min_spread(moments: np.ndarray) -> np.ndarray:
    """(Q,) moment of the soundings along the direction in which they spread least [m^2]."""
    xx, xy, yy = moments.T[:3]
    return np.maximum((xx + yy) / 2 - np.hypot((xx - yy) / 2, xy), 1e-300)


def _noise(departures: np.ndarray, relative: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(C,) standard deviations of common slopes, from the (Q, 2) departures of the lines' slopes from them; `relative`
    (C,) are the standard deviations up to a common factor.

    With two lines, the error of their mean slope is as large as their departure from it. The median withstands cells
    with steps.
    """
    scaled = np.abs(departures) / np.maximum(relative, 1e-9)[cells, None]
    return 1.4826 * float(np.median(scaled)) * relative if len(scaled) else relative
