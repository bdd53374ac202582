"""The points of all scans in one frame, one per voxel, each with its uncertainty.

In a voxel the points of each scan are averaged, and these means are weighted by the inverse of their variances. A
mean's variance is the sum of that by the scan's pose and of the scatter of its ranges over the number of its points.
Both are means over the three coordinates (a third of the covariance's trace, which unlike its largest eigenvalue adds
up exactly in all directions). `PointMap.sigma` averages the scatter away but not the poses' part: all points of a scan
share its pose's error, and neighboring poses share most of theirs, so the poses' standard deviations are averaged
without reduction. If the poses were independent, sigma would be up to sqrt(seen) too large.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.slam.map.cell import cell_keys
from sonarmap.slam.map.placed import PlacedScans, pose_variance

MERGE_ROWS = 300_000  # smallest number of scans' cells that are merged into the map's, so that merging stays cheap


@dataclass(frozen=True, slots=True)
class PointMap:
    """A fused map: for every voxel that holds a point, the weighted mean of its points.

    Attributes:
        points: (M, 3) float64 [m, world], ordered by voxel in x, then y, then z.
        sigma: (M,) float32, standard deviation of each of the point's three coordinates, their root mean square [m].
        strength: (M,) float32, mean linear echo of the points that have one (NaN where none has), or None
            where no scan gives any.
        scan: (M,) int32, index of the scan with the most points in the voxel, the earliest of equals.
        seen: (M,) int32, number of different scans with a point in the voxel, >= 1.
        count: (M,) int32, number of points in the voxel, >= 1.
        survey: (M,) int32, the survey of `scan`.
        voxel: edge of a voxel [m].
        left_out: number of points that lie too far from the others for the map to hold them: stray echoes.
        removed: number of map points that were taken out because free space contradicts them.
        doubted: number of map points that were taken out because too few scans saw them where others looked.
        looked: (M,) int32, number of scans with dense beams in the point's direction, whether or not they saw it; None
            if not computed.
    """

    points: np.ndarray
    sigma: np.ndarray
    strength: np.ndarray | None
    scan: np.ndarray
    seen: np.ndarray
    count: np.ndarray
    survey: np.ndarray
    voxel: float
    left_out: int = 0
    removed: int = 0
    doubted: int = 0
    looked: np.ndarray | None = None

    def __str__(self) -> str:
        edges = zip("xyz", self.points.min(axis=0).tolist(), self.points.max(axis=0).tolist(), strict=True)
        extent = ", ".join(f"{axis} {low:.2f} to {high:.2f}" for axis, low, high in edges)
        return (
            f"{counted(len(self.points), 'point')}, voxels of {self.voxel:.3g} m\n"
            f"  {extent} m\n"
            f"  sigma {np.median(self.sigma):.3f} m in the median; {np.mean(self.seen > 1):.0%} seen by several scans"
        )

    def take(self, chosen: np.ndarray) -> PointMap:
        """The map with only the `chosen` points, (M,) bool; the numbers of removed points stay."""
        names = ("points", "sigma", "strength", "scan", "seen", "count", "survey", "looked")
        columns = {name: getattr(self, name) for name in names}
        return replace(self, **{name: None if column is None else column[chosen] for name, column in columns.items()})


def fuse(placed: PlacedScans) -> PointMap:
    """Bring every scan's points into the world and keep one per voxel.

    The same input gives the same bytes. Scans are thinned one by one, and merged as soon as they have as many cells as
    the map, so that memory grows with the map, not with the number of points. Points more than a million voxels from
    the middle of the first scan are left out and counted.
    """
    voxel = placed.voxel
    origin, merged = placed.origin, list[_Cells]()
    for k in range(len(placed.scans)):
        merged.append(_thinned(placed, k, origin))
        if sum(len(cells.key) for cells in merged[1:]) > max(MERGE_ROWS, len(merged[0].key)):
            merged = [_merge(merged)]
    cells = _merge(merged)
    if not len(cells.key):
        raise InputError(f"the map's voxel is {voxel} m, too small for points this far apart; give a larger one")
    with np.errstate(invalid="ignore"):  # 0 / 0: a cell without any echo strength
        strength = (cells.echo / cells.echoes).astype(np.float32)
    survey_of = dict(zip(placed.indices, placed.surveys, strict=True))
    indices, inverse = np.unique(cells.scan, return_inverse=True)
    return PointMap(
        points=cells.total / cells.weight[:, None] + origin,
        sigma=(np.sqrt(cells.scatter + cells.drift**2) / cells.weight).astype(np.float32),
        strength=strength if np.isfinite(strength).any() else None,
        scan=cells.scan,
        seen=cells.seen,
        count=cells.count,
        survey=np.array([survey_of[index] for index in indices.tolist()], np.int32)[inverse],
        voxel=voxel,
        left_out=sum(len(each.points) for each in placed.scans) - int(cells.count.sum()),
    )


@dataclass(frozen=True, slots=True)
class _Cells:
    """Sums over the points of each cell; rows of one cell can be merged in any grouping."""

    key: np.ndarray  # (K,) int64, the cell
    weight: np.ndarray  # (K,) float64 [1/m^2], sum over scans of the inverse variance of their mean
    total: np.ndarray  # (K, 3) float64 [1/m], sum of weight times mean, from the lattice's origin
    scatter: np.ndarray  # (K,) float64 [1/m^2], sum of weight^2 times the mean's variance by the scatter of its ranges
    drift: np.ndarray  # (K,) float64 [1/m], sum of weight times the mean's standard deviation by its pose
    # count, echoes: (K,) int32, number of points, and of points with an echo strength
    count: np.ndarray
    echo: np.ndarray  # (K,) float64, sum of the strengths
    echoes: np.ndarray
    most: np.ndarray  # (K,) int32, the largest number of points from one scan, and `scan`: (K,) int32, which one
    scan: np.ndarray
    seen: np.ndarray  # (K,) int32, number of scans


def _thinned(placed: PlacedScans, k: int, origin: np.ndarray) -> _Cells:
    """One scan's points as one row per cell."""
    scan, T = placed.scans[k], placed.T_world_sensor[k]
    local = scan.points.astype(np.float64)
    keys, near = cell_keys(T.apply(local), placed.voxel, origin)
    key, cell, count = np.unique(keys, return_inverse=True, return_counts=True)
    local, size, count = local[near], len(key), count.astype(np.int32)
    mean = np.stack([np.bincount(cell, local[:, axis], size) for axis in range(3)], axis=1) / count[:, None]
    by_pose = pose_variance(mean, placed.covariances[k])
    # the scatter is along the beam: its mean over the three coordinates is a third
    by_scatter = placed.beams[k].sigma ** 2 / (3 * count)
    weight = 1 / (by_pose + by_scatter)
    return _Cells(
        key=key,
        weight=weight,
        total=weight[:, None] * (T.apply(mean) - origin),
        scatter=weight**2 * by_scatter,
        drift=weight * np.sqrt(by_pose),
        count=count,
        echo=np.zeros(size) if scan.strength is None else np.bincount(cell, scan.strength[near], size),
        echoes=np.zeros(size, np.int32) if scan.strength is None else count,
        most=count,
        scan=np.full(size, placed.indices[k], np.int32),
        seen=np.ones(size, np.int32),
    )


def _merge(tables: list[_Cells]) -> _Cells:
    """Merge the rows of each cell into one, ordered by cell."""

    def column(name: str) -> np.ndarray:
        return np.concatenate([getattr(table, name) for table in tables])

    order = np.lexsort((column("scan"), -column("most"), column("key")))
    starts = np.flatnonzero(np.diff(column("key")[order], prepend=-1))
    if not len(starts):
        return tables[0]
    firsts = {name: column(name)[order[starts]] for name in ("key", "most", "scan")}
    others = [field.name for field in fields(_Cells) if field.name not in firsts]
    return _Cells(**firsts, **{name: np.add.reduceat(column(name)[order], starts, axis=0) for name in others})
