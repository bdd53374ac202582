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
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.map.beams import Beams, beams_of
from sonarmap.slam.map.cell import lattice_origin
from sonarmap.slam.map.fused_cells import FusedCells, thin
from sonarmap.spectral.scan import Scan


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
        looked: (M,) int32, number of scans whose beams went that way, those that saw the point among them; None where
            that was not asked.
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

    def take(self, chosen: np.ndarray) -> PointMap:
        """These points alone, (M,) bool; the map's counts stay."""
        names = ("points", "sigma", "strength", "scan", "seen", "count", "survey", "looked")
        columns = {name: getattr(self, name) for name in names}
        return replace(self, **{name: None if column is None else column[chosen] for name, column in columns.items()})


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

    The same input gives the same bytes. Scans are thinned one by one before they are merged, tile by tile, so that
    memory grows with the map, not with the number of points. Points more than a million voxels from the middle of
    the first scan are left out and counted.

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
    fused = FusedCells()
    for k, seen_by in enumerate(scans):
        covariance = np.zeros((6, 6)) if covariances is None else covariances[k]
        scan_beams = beams_of(seen_by.points, voxel) if beams is None else beams[k]
        fused.add(thin(seen_by, T_world_sensor[k], covariance, scan_beams, names[k], voxel, origin))
    survey_of = dict(zip(names, surveys if surveys is not None else [0] * len(names), strict=True))
    columns = fused.columns()
    if not columns:
        raise InputError(f"the map's voxel is {voxel} m, too small for points this far apart; give a larger one")
    order = np.argsort(columns.pop("key"))
    points = columns.pop("points")[order]
    points += origin
    sigma, strength, scan, seen, count = (
        columns.pop(name)[order] for name in ("sigma", "strength", "scan", "seen", "count")
    )
    called, which = np.unique(scan, return_inverse=True)
    return PointMap(
        points=points,
        sigma=sigma,
        strength=strength if np.isfinite(strength).any() else None,
        scan=scan,
        seen=seen,
        count=count,
        survey=np.array([survey_of[index] for index in called.tolist()], np.int32)[which],
        voxel=voxel,
        left_out=sum(len(each.points) for each in scans) - int(count.sum()),
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
