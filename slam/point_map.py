"""The points of all scans in one frame, one per voxel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial.transform import RigidTransform

from kernels.errors import InputError
from slam.cell import cell_keys, lattice_origin
from spectral.scan import Scan

MERGE_ROWS = 1_000_000  # rows that wait at least before they are merged, so that merging stays cheap


@dataclass(frozen=True, slots=True)
class PointMap:
    """A fused map: for every voxel that holds a point, the mean of its points.

    Attributes:
        points: (M, 3) float64 [m, world], ordered by voxel in x, then y, then z.
        strength: (M,) float32, mean linear echo of the points that have one (NaN where none has), or None
            where no scan gives any.
        scan: (M,) int32, index of the scan with the most points in the voxel, the earliest of equals.
        seen: (M,) int32, number of different scans with a point in the voxel, >= 1.
        hits: (M,) int32, number of points in the voxel, >= 1.
        voxel: edge of a voxel [m].
        left_out: number of points that lie too far from the others for the map to hold them: stray echoes.
    """

    points: np.ndarray
    strength: np.ndarray | None
    scan: np.ndarray
    seen: np.ndarray
    hits: np.ndarray
    voxel: float
    left_out: int = 0


def fuse(
    scans: Sequence[Scan], T_world_sensor: RigidTransform, voxel: float, indices: Sequence[int] | None = None
) -> PointMap:
    """Bring every scan's points into the world and keep one per voxel.

    The same input gives the same bytes. Scans are thinned one by one before they are merged, so that memory
    grows with the map, not with the number of points. Points more than a million voxels from the middle of the first
    scan are left out and counted.

    Args:
        scans: S scans.
        T_world_sensor: their S poses.
        voxel: edge of a voxel [m].
        indices: what to call the scans in `PointMap.scan`; 0..S-1 by default.

    Raises:
        InputError: no scan, another number of poses, a voxel that is not positive, or one so small that no
            point is within reach.
    """
    if not scans or len(T_world_sensor) != len(scans):
        raise InputError(f"{len(scans)} scans and {len(T_world_sensor)} poses: wanted one pose for every scan")
    if not (np.isfinite(voxel) and voxel > 0):
        raise InputError(f"the map's voxel is {voxel} m; wanted a positive length")
    origin = lattice_origin(T_world_sensor[0].apply(scans[0].points.astype(np.float64)), voxel)
    table, waiting = None, []
    for scan, index, T in zip(scans, indices or range(len(scans)), T_world_sensor, strict=True):
        points = T.apply(scan.points.astype(np.float64))
        keys, near = cell_keys(points, voxel, origin)
        strength = None if scan.strength is None else scan.strength[near]
        waiting.append(_thin(keys, points[near], strength, index))
        if sum(len(rows.key) for rows in waiting) > max(MERGE_ROWS, len(table.key) if table else 0):
            table, waiting = _merge([table, *waiting] if table else waiting), []
    table = _merge([table, *waiting] if table else waiting)
    if len(table.key) == 0:
        raise InputError(f"the map's voxel is {voxel} m, too small for points this far apart; give a larger one")
    with np.errstate(invalid="ignore"):  # 0 / 0: a voxel without any echo strength is NaN
        strength = (table.echo / table.echoes).astype(np.float32) if table.echoes.any() else None
    return PointMap(
        points=table.total / table.hits[:, None],
        strength=strength,
        scan=table.scan,
        seen=table.seen,
        hits=table.hits,
        voxel=voxel,
        left_out=sum(len(scan.points) for scan in scans) - int(table.hits.sum()),
    )


@dataclass(frozen=True, slots=True)
class _Cells:
    """Sums over the points of each cell; rows of one cell can be merged in any grouping.

    Attributes:
        key: (K,) int64, the cell.
        total: (K, 3) float64 [m], sum of the points.
        hits, echoes: (K,) int32, number of points, and of points with an echo strength.
        echo: (K,) float64, sum of the strengths.
        most: (K,) int32, the largest number of points from one scan, and `scan`: (K,) int32, which one.
        seen: (K,) int32, number of scans.
    """

    key: np.ndarray
    total: np.ndarray
    hits: np.ndarray
    echo: np.ndarray
    echoes: np.ndarray
    most: np.ndarray
    scan: np.ndarray
    seen: np.ndarray


def _thin(keys: np.ndarray, points: np.ndarray, strength: np.ndarray | None, index: int) -> _Cells:
    """One scan's points as one row per cell."""
    key, cell, hits = np.unique(keys, return_inverse=True, return_counts=True)
    count, hits = len(key), hits.astype(np.int32)
    sums = [np.bincount(cell, points[:, axis], count) for axis in range(3)]
    echo = np.zeros(count) if strength is None else np.bincount(cell, strength, count)
    return _Cells(
        key=key,
        total=np.stack(sums, axis=1),
        hits=hits,
        echo=echo,
        echoes=np.zeros(count, np.int32) if strength is None else hits,
        most=hits,
        scan=np.full(count, index, np.int32),
        seen=np.ones(count, np.int32),
    )


def _merge(tables: list[_Cells]) -> _Cells:
    """Rows of the same cell become one."""
    rows = {field.name: np.concatenate([getattr(t, field.name) for t in tables]) for field in fields(_Cells)}
    order = np.lexsort((rows["scan"], -rows["most"], rows["key"]))
    rows = {name: column[order] for name, column in rows.items()}
    starts = np.flatnonzero(np.diff(rows["key"], prepend=-1))
    first = {name: rows[name][starts] for name in ("key", "most", "scan")}
    names = ("total", "hits", "echo", "echoes", "seen")
    sums = {name: np.add.reduceat(rows[name], starts, axis=0) for name in names}
    return _Cells(**first, **sums)
