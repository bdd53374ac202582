"""Scans thinned to one row a cell, and the rows of all scans merged."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.map.beams import Beams
from sonarmap.slam.map.cell import BITS, cell_keys
from sonarmap.spectral.scan import Scan

# Rows of a tile that wait at least before they are merged, so that merging stays cheap.
MERGE_ROWS = 50_000
# The bits of a cell's number that tell its tile, of 128 cells along each axis.
_TILE = ~sum(0x7F << (BITS * axis) for axis in range(3))


def pose_variance(points: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(N,) float64 [m^2]: mean square, over the three coordinates, of the error that a pose's error brings to points.

    With T_true = T Exp((w, v)) a point p moves by R (w x p + v): a third of the trace of that vector's covariance,
    which no rotation R changes.

    Args:
        points: (N, 3) float64 [m, sensor frame].
        covariance: (6, 6) of (w, v), rotation first [rad, m].
    """
    turn, cross, shift = covariance[:3, :3], covariance[:3, 3:], covariance[3:, 3:]
    twisted = np.trace(turn) * np.eye(3) - turn  # |w x p|^2 is p' (w'w I - w w') p
    # (w x p) . v is p . (v x w)
    lever = np.array([cross[2, 1] - cross[1, 2], cross[0, 2] - cross[2, 0], cross[1, 0] - cross[0, 1]])
    squares = np.einsum("ni,ni->n", points @ twisted, points) + 2 * points @ lever + np.trace(shift)
    return np.maximum(squares, 0.0) / 3


@dataclass(frozen=True, slots=True)
class Cells:
    """Sums over the points of each cell; rows of one cell can be merged in any grouping.

    Attributes:
        key: (K,) int64, the cell.
        weight: (K,) float64 [1/m^2], sum over scans of the inverse variance of their mean.
        total: (K, 3) float64 [1/m], sum of weight times mean, from the lattice's origin.
        scatter: (K,) float64 [1/m^2], sum of weight^2 times the variance that is the mean's own.
        drift: (K,) float64 [1/m], sum of weight times the standard deviation that the pose brings.
        count, echoes: (K,) int32, number of points, and of points with an echo strength.
        echo: (K,) float64, sum of the strengths.
        most: (K,) int32, the largest number of points from one scan, and `scan`: (K,) int32, which one.
        seen: (K,) int32, number of scans.
    """

    key: np.ndarray
    weight: np.ndarray
    total: np.ndarray
    scatter: np.ndarray
    drift: np.ndarray
    count: np.ndarray
    echo: np.ndarray
    echoes: np.ndarray
    most: np.ndarray
    scan: np.ndarray
    seen: np.ndarray

    def take(self, chosen: np.ndarray) -> Cells:
        """These rows alone."""
        return Cells(**{field.name: getattr(self, field.name)[chosen] for field in fields(Cells)})

    def columns(self) -> dict[str, np.ndarray]:
        """A map's columns, with the cells' keys; points from the lattice's origin, strength NaN where there is none."""
        with np.errstate(invalid="ignore"):  # 0 / 0: a cell without any echo strength
            strength = (self.echo / self.echoes).astype(np.float32)
        sigma = np.sqrt(self.scatter + self.drift**2) / self.weight
        return {
            "key": self.key,
            "points": self.total / self.weight[:, None],
            "sigma": sigma.astype(np.float32),
            "strength": strength,
            "scan": self.scan,
            "seen": self.seen,
            "count": self.count,
        }


class FusedCells:
    """Cells of all scans so far, by tiles, which are small enough to be merged in little memory."""

    def __init__(self) -> None:
        self._merged: dict[int, Cells] = {}
        self._waiting: dict[int, list[Cells]] = defaultdict(list)
        self._rows: dict[int, int] = defaultdict(int)

    def add(self, cells: Cells) -> None:
        """Add the cells of one scan."""
        if not len(cells.key):
            return
        tile = cells.key & _TILE
        order = np.argsort(tile, kind="stable")
        numbers, first = np.unique(tile[order], return_index=True)
        for number, chosen in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
            self._waiting[number].append(cells.take(chosen))
            self._rows[number] += len(chosen)
            merged = self._merged.get(number)
            if self._rows[number] > max(MERGE_ROWS, len(merged.key) if merged else 0):
                self._merge(number)

    def columns(self) -> dict[str, np.ndarray]:
        """The columns of a map, with the cells' keys, in no order; nothing is left."""
        parts: dict[str, list[np.ndarray]] = defaultdict(list)
        for number in sorted(self._waiting):
            self._merge(number)
            for name, column in self._merged.pop(number).columns().items():
                parts[name].append(column)
        return {name: np.concatenate(parts.pop(name)) for name in list(parts)}

    def _merge(self, number: int) -> None:
        merged = self._merged.get(number)
        waiting = self._waiting[number]
        if waiting:
            self._merged[number] = _merge([merged, *waiting] if merged else waiting)
        self._waiting[number], self._rows[number] = [], 0


def thin(
    scan: Scan, T: RigidTransform, covariance: np.ndarray, beams: Beams, index: int, voxel: float, origin: np.ndarray
) -> Cells:
    """One scan's points as one row per cell."""
    local = scan.points.astype(np.float64)
    keys, near = cell_keys(T.apply(local), voxel, origin)
    key, cell, count = np.unique(keys, return_inverse=True, return_counts=True)
    local, size, count = local[near], len(key), count.astype(np.int32)
    mean = np.stack([np.bincount(cell, local[:, axis], size) for axis in range(3)], axis=1) / count[:, None]
    open_pose = pose_variance(mean, covariance)
    own = beams.sigma(np.linalg.norm(mean, axis=1)) ** 2 / (3 * count)  # along the beam: one coordinate of three
    weight = 1 / (open_pose + own)
    has_strength = scan.strength is not None
    return Cells(
        key=key,
        weight=weight,
        total=weight[:, None] * (T.apply(mean) - origin),
        scatter=weight**2 * own,
        drift=weight * np.sqrt(open_pose),
        count=count,
        echo=np.bincount(cell, scan.strength[near], size) if scan.strength is not None else np.zeros(size),
        echoes=count if has_strength else np.zeros(size, np.int32),
        most=count,
        scan=np.full(size, index, np.int32),
        seen=np.ones(size, np.int32),
    )


def _merge(tables: list[Cells]) -> Cells:
    """Rows of the same cell become one."""
    rows = {field.name: np.concatenate([getattr(t, field.name) for t in tables]) for field in fields(Cells)}
    order = np.lexsort((rows["scan"], -rows["most"], rows["key"]))
    rows = {name: column[order] for name, column in rows.items()}
    starts = np.flatnonzero(np.diff(rows["key"], prepend=-1))
    first = {name: rows[name][starts] for name in ("key", "most", "scan")}
    sums = {name: np.add.reduceat(column, starts, axis=0) for name, column in rows.items() if name not in first}
    return Cells(**first, **sums)
