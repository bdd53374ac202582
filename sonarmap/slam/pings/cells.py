"""Patches: the soundings of a line in a horizontal cell; and the cells in which several lines have one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import PingLine

_SOUNDINGS_PER_CELL = 16.0  # of a line, about
_LEAST_WIDTH = 2.0  # of a cell [spacings of soundings]
_MIN_SOUNDINGS = 5  # of a cell that has a slope
_NARROWEST = 0.02  # (smaller extent / larger)^2 of soundings that show a slope: along a line they show none
# Weights in a cell's slope of its own soundings, and of those of its neighbors beside it and across a corner.
_OWN = 4.0
_BESIDE = 2.0
_CORNER = 1.0


@dataclass(frozen=True, slots=True)
class Patches:
    """Of one line, ascending by cell.

    Attributes:
        keys: (Q,) int64, of the cells: East's number in the upper 32 bits, North's in the lower.
        counts: (Q,) of soundings.
        means: (Q, 3) of soundings [m]: East and North from the cell's center, and Up.
        moments: (Q, 6) of soundings about their means, summed [m^2]: xx, xy, yy, xz, yz, zz.
        columns: (Q, E) means of what else is wanted of the soundings.
    """

    keys: np.ndarray
    counts: np.ndarray
    means: np.ndarray
    moments: np.ndarray
    columns: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, cell: float, columns: np.ndarray) -> "Patches":
        """Of (N, 3) world points [m] in cells with edges of `cell` [m], and (N, E) columns."""
        keys, own = np.unique(keys_of(points, cell), return_inverse=True)
        counts = np.bincount(own, minlength=len(keys)).astype(float)
        local = np.column_stack([points[:, :2] - (_numbers(keys)[own] + 0.5) * cell, points[:, 2]])
        means = _summed(local, own, len(keys)) / counts[:, None]
        x, y, z = (local - means[own]).T
        products = np.column_stack([x * x, x * y, y * y, x * z, y * z, z * z])
        others = _summed(columns, own, len(keys)) / counts[:, None]
        return cls(keys, counts, means, _summed(products, own, len(keys)), others)

    def pooled(self) -> tuple[np.ndarray, np.ndarray]:
        """(Q, 6) moments and (Q,) degrees of freedom of a patch together with those around it.

        Each patch is about its own mean: what its navigation is wrong by from one ping to another costs no slope.
        """
        moments, freedom = np.zeros_like(self.moments), np.zeros_like(self.counts)
        for east in (-1, 0, 1):
            for north in (-1, 0, 1):
                weight = (_OWN, _BESIDE, _CORNER)[abs(east) + abs(north)]
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
        centers: (C, 2) of cells, East and North [m].
        slopes: (C, 2) dz/dEast and dz/dNorth, common to the lines.
        slope_noise: (C,) standard deviations of slopes, as lines differ in them, without a unit.
        cells, lines: (Q,) int64, the cell and the line of each patch.
        heights: (Q,) Up of the patch at its cell's center [m].
        variances: (Q,) of heights as the soundings' scatter about the slope lets expect [m^2].
        columns: (Q, E) means of what else was wanted of the soundings.
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
        """Of the patches of each line."""
        pooled = [own.pooled() for own in patches]
        moments, freedom = np.concatenate([m for m, _ in pooled]), np.concatenate([f for _, f in pooled])
        keys, counts, means, columns = (
            np.concatenate([getattr(own, name) for own in patches]) for name in ("keys", "counts", "means", "columns")
        )
        lines = np.repeat(np.arange(len(patches)), [len(own.keys) for own in patches])
        enough = (counts >= _MIN_SOUNDINGS) & _wide(moments)
        several = np.unique(keys[enough], return_counts=True)
        chosen = np.flatnonzero(enough & np.isin(keys, several[0][several[1] > 1]))
        chosen = chosen[np.lexsort([lines[chosen], keys[chosen]])]
        own_keys, cells = np.unique(keys[chosen], return_inverse=True)
        common = _summed(moments[chosen], cells, len(own_keys))
        slopes, own_slopes = _slopes(common), _slopes(moments[chosen])
        scatter = np.maximum(moments[chosen, 5] - (own_slopes * moments[chosen, 3:5]).sum(axis=1), 0)
        scatter /= np.maximum(freedom[chosen], 1)
        variances = scatter / counts[chosen]
        heights = means[chosen, 2] - (slopes[cells] * means[chosen, :2]).sum(axis=1)
        mean_scatter = np.bincount(cells, weights=scatter, minlength=len(own_keys)) / np.bincount(cells)
        if len(mean_scatter):  # a few soundings lie in a plane by chance
            mean_scatter = np.maximum(mean_scatter, np.median(mean_scatter))
        noise = _noise(own_slopes - slopes[cells], np.sqrt(mean_scatter / _least_spread(common)), cells)
        centers = (_numbers(own_keys) + 0.5) * cell
        return cls(cell, centers, slopes, noise, cells, lines[chosen], heights, variances, columns[chosen])

    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Two arrays of patches, those of every two lines in a cell, the line with the lower number first."""
        first, second = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for step in range(1, len(self.cells)):
            same = np.flatnonzero(self.cells[step:] == self.cells[:-step])
            if not len(same):
                break
            first.append(same)
            second.append(same + step)
        return np.concatenate(first), np.concatenate(second)


def checked_cell(cell: float | None, lines: Sequence[PingLine]) -> float:
    """The given edge of cells [m]; or, of None, one that holds a good handful of soundings of a line: by the distance
    of pings and of soundings in a ping, of which the wider are decisive, as lines overlap at their edges.

    Raises:
        InputError: an edge that is not above 0, no lines, or none with two soundings at different places.
    """
    if not lines:
        raise InputError("no lines are given; wanted one or more")
    if cell is not None:
        if not 0 < cell < np.inf:
            raise InputError(f"`cell` is {cell} m; wanted an edge above 0, or none for one by the soundings' distances")
        return cell
    edges: list[float] = []
    for line in lines:
        along = np.linalg.norm(np.diff(line.places[np.unique(line.pings), :2], axis=0), axis=1)
        across = np.linalg.norm(np.diff(line.points[:, :2], axis=0), axis=1)[np.diff(line.pings) == 0]
        if len(along) and len(across):
            a, b = float(np.median(along)), float(np.percentile(across, 75))
            edges.append(max(np.sqrt(_SOUNDINGS_PER_CELL * a * b), _LEAST_WIDTH * a, _LEAST_WIDTH * b))
    edge = float(np.median(edges)) if edges else 0.0
    if edge <= 0:
        raise InputError(f"{len(lines)} lines have no distances between soundings; give `cell`, the edge of cells [m]")
    return edge


def keys_of(points: np.ndarray, cell: float) -> np.ndarray:
    """(N,) int64, of the cells with edges of `cell` [m] in which (N, 3) points [m] lie."""
    east, north = np.floor(points[:, :2] / cell).astype(np.int64).T
    return (east << 32) + north


def _numbers(keys: np.ndarray) -> np.ndarray:
    """(Q, 2) East's and North's numbers; North's may be negative, which borrows from East's."""
    north = (keys + (1 << 31)) % (1 << 32) - (1 << 31)
    return np.column_stack([(keys - north) >> 32, north])


def _summed(values: np.ndarray, groups: np.ndarray, count: int) -> np.ndarray:
    """(count, E) sums of (N, E) rows over each group."""
    sums = [np.bincount(groups, weights=column, minlength=count) for column in values.T]
    return np.column_stack(sums) if sums else np.zeros((count, 0))


def _wide(moments: np.ndarray) -> np.ndarray:
    """(Q,) bool, whether soundings spread in both directions."""
    xx, xy, yy = moments.T[:3]
    return xx * yy - xy**2 > _NARROWEST * (xx + yy) ** 2


def _slopes(moments: np.ndarray) -> np.ndarray:
    """(Q, 2) dz/dEast and dz/dNorth by least squares."""
    xx, xy, yy, xz, yz, _ = moments.T
    return np.column_stack([yy * xz - xy * yz, xx * yz - xy * xz]) / np.maximum(xx * yy - xy**2, 1e-300)[:, None]


def _least_spread(moments: np.ndarray) -> np.ndarray:
    """(Q,) of soundings in the direction in which they spread least [m^2]."""
    xx, xy, yy = moments.T[:3]
    return np.maximum((xx + yy) / 2 - np.hypot((xx - yy) / 2, xy), 1e-300)


def _noise(departures: np.ndarray, relative: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(C,) of common slopes, from what (Q, 2) slopes of lines depart from the common ones by; `relative` (C,) says how
    the noises of cells are to one another.

    Two slopes differ by twice their departure, and their mean's error is half of that difference's, so that both are
    alike. The median withstands cells with steps.
    """
    scaled = np.abs(departures) / np.maximum(relative, 1e-9)[cells, None]
    return 1.4826 * float(np.median(scaled)) * relative if len(scaled) else relative
