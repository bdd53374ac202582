# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""The points of all scans in one frame, one per voxel, each with its uncertainty.

In a voxel the points of each scan are averaged, and these means by the inverse of their variances. A mean's variance
is what the scan's pose leaves open there, and the scatter of its ranges over the number of its points. Both are mean
squares of the three coordinates (a third of the covariance's trace: unlike its largest eigenvalue that adds up
exactly, whatever the directions). `PointMap.sigma` averages the scatter away but not the poses' part: all points of a
scan share its pose's error, and neighboring poses share most of theirs, so the poses' standard deviations are
averaged as they are. Were the poses independent, sigma would be up to sqrt(seen) too large.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Sized
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from kernels.errors import InputError
from slam.map.beams import Beams, beams_of
from slam.map.cell import cell_keys, lattice_origin
from spectral.scan import Scan

MERGE_ROWS = 1_000_000  # rows that wait at least before they are merged, so that merging stays cheap


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

    def keep(self, kept: np.ndarray) -> PointMap:
        """The map without the points that `kept`, (M,) bool, does not name; they count as removed."""
        names = ("points", "sigma", "strength", "scan", "seen", "count", "survey")
        columns = {name: getattr(self, name) for name in names}
        chosen = {name: None if column is None else column[kept] for name, column in columns.items()}
        return replace(self, **chosen, removed=self.removed + int(np.count_nonzero(~kept)))


def fuse(
    scans: Sequence[Scan],
    T_world_sensor: RigidTransform,
    voxel: float,
    indices: Sequence[int] | None = None,
    *,
    covariances: np.ndarray | None = None,
    surveys: Sequence[int] | None = None,
    beams: Sequence[Beams] | None = None,
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
        covariances: (S, 6, 6) of the poses, rotation first [rad, m], body tangent; certain without.
        surveys: S numbers, the survey that each scan belongs to; all 0 by default.
        beams: of the scans, where they are known already.

    Raises:
        InputError: no scan, another number of poses, covariances, surveys or beams, a voxel that is not positive, or
            one so small that no point is within reach.
    """
    _check(scans, T_world_sensor, voxel, {"covariances": covariances, "surveys": surveys, "beams": beams})
    origin = lattice_origin(T_world_sensor[0].apply(scans[0].points.astype(np.float64)), voxel)
    names = list(range(len(scans)) if indices is None else indices)
    table: _Cells | None = None
    waiting: list[_Cells] = []
    for k, scan in enumerate(scans):
        covariance = np.zeros((6, 6)) if covariances is None else covariances[k]
        scan_beams = beams_of(scan.points, voxel) if beams is None else beams[k]
        waiting.append(_thin(scan, T_world_sensor[k], covariance, scan_beams, names[k], voxel, origin))
        if sum(len(rows.key) for rows in waiting) > max(MERGE_ROWS, len(table.key) if table else 0):
            table, waiting = _merge([table, *waiting] if table else waiting), []
    table = _merge([table, *waiting] if table else waiting)
    if len(table.key) == 0:
        raise InputError(f"the map's voxel is {voxel} m, too small for points this far apart; give a larger one")
    with np.errstate(invalid="ignore"):  # 0 / 0: a voxel without any echo strength is NaN
        strength = (table.echo / table.echoes).astype(np.float32) if table.echoes.any() else None
    survey_of = dict(zip(names, surveys if surveys is not None else [0] * len(names), strict=True))
    called, which = np.unique(table.scan, return_inverse=True)
    return PointMap(
        points=origin + table.total / table.weight[:, None],
        sigma=(np.sqrt(table.scatter + table.drift**2) / table.weight).astype(np.float32),
        strength=strength,
        scan=table.scan,
        seen=table.seen,
        count=table.count,
        survey=np.array([survey_of[index] for index in called.tolist()], np.int32)[which],
        voxel=voxel,
        left_out=sum(len(scan.points) for scan in scans) - int(table.count.sum()),
    )


def _check(
    scans: Sequence[Scan], T_world_sensor: RigidTransform, voxel: float, per_scan: Mapping[str, Sized | None]
) -> None:
    for name, values in {"poses": T_world_sensor, **per_scan}.items():
        if not scans or (values is not None and len(values) != len(scans)):
            count = 0 if values is None else len(values)
            raise InputError(f"{len(scans)} scans and {count} {name}: wanted scans, and one for every scan")
    if not (np.isfinite(voxel) and voxel > 0):
        raise InputError(f"the map's voxel is {voxel} m; wanted a positive length")


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
    squares = np.einsum("ni,ij,nj->n", points, twisted, points) + 2 * points @ lever + np.trace(shift)
    return np.maximum(squares, 0.0) / 3


@dataclass(frozen=True, slots=True)
class _Cells:
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


def _thin(
    scan: Scan, T: RigidTransform, covariance: np.ndarray, beams: Beams, index: int, voxel: float, origin: np.ndarray
) -> _Cells:
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
    return _Cells(
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


def _merge(tables: list[_Cells]) -> _Cells:
    """Rows of the same cell become one."""
    rows = {field.name: np.concatenate([getattr(t, field.name) for t in tables]) for field in fields(_Cells)}
    order = np.lexsort((rows["scan"], -rows["most"], rows["key"]))
    rows = {name: column[order] for name, column in rows.items()}
    starts = np.flatnonzero(np.diff(rows["key"], prepend=-1))
    first = {name: rows[name][starts] for name in ("key", "most", "scan")}
    sums = {name: np.add.reduceat(column, starts, axis=0) for name, column in rows.items() if name not in first}
    return _Cells(**first, **sums)
