"""Registration by points, one per voxel with its normal: the overlap, covariance and acceptance common to all methods.

The acceptance thresholds separate eight simulated pairs at the noise of the paper and voxels of 1 m (seeds 100 to 107
of `random_pair` on three scenes) from five pairs of scans that share nothing.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan


@contextmanager
def quiet(one_thread: bool = False) -> Iterator[None]:
    """Let Open3D print errors only and, if asked to, use one thread: sums over several threads differ in their last
    bits from run to run."""
    import open3d as o3d

    before = o3d.utility.get_max_threads()
    o3d.utility.set_max_threads(1 if one_thread else before)
    try:
        with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
            yield
    finally:
        o3d.utility.set_max_threads(before)


FEWEST_POINTS = 20  # also the number of occupied voxels that the spectral registration needs
NORMAL_REACH = 2.0  # radius of the neighborhood for a normal [voxels], as in Open3D's example
NORMAL_NEIGHBORS = 30  # largest number of points in it


@dataclass(frozen=True, slots=True)
class ThinnedCloud:
    """A scan thinned to one point per voxel."""

    name: str  # of the scan
    points: np.ndarray  # (m, 3) float64 [m, sensor frame], the mean of the points of every occupied voxel
    normals: np.ndarray  # (m, 3) float64, unit length, on the side of the sensor
    tree: KDTree  # of the points
    extra: Any = None  # added by a method: features, or the points in the format of another library


def thin(scan: Scan, voxel: float) -> ThinnedCloud:
    """One point per voxel of edge `voxel` [m], with its normal. Raises InputError: the points fill too few voxels."""
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(scan.points.astype(np.float64)))
    try:
        cloud = cloud.voxel_down_sample(voxel)
    except RuntimeError as error:  # the voxel count along an axis exceeds 32 bits
        raise InputError(
            f"{scan.name}: voxels of {voxel:g} m are too small for the scan's extent. Give larger ones with --voxel."
        ) from error
    if len(cloud.points) < FEWEST_POINTS:
        raise InputError(
            f"{scan.name}: its points fill {len(cloud.points)} voxels of {voxel:.3g} m; wanted at least "
            f"{FEWEST_POINTS}. Give a scan with more structure, or smaller voxels with --voxel."
        )
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(NORMAL_REACH * voxel, NORMAL_NEIGHBORS))
    cloud.orient_normals_towards_camera_location(np.zeros(3))
    points, normals = np.asarray(cloud.points), np.asarray(cloud.normals)
    if scan.viewpoints is not None:
        _, nearest = KDTree(scan.points).query(points)
        away = np.sum(normals * (scan.viewpoints[nearest] - points), axis=1) < 0
        normals = np.where(away[:, None], -normals, normals)
    return ThinnedCloud(scan.name, points, normals, KDTree(points))


def to_open3d(cloud: ThinnedCloud) -> Any:
    """The cloud as Open3D's PointCloud."""
    import open3d as o3d

    converted = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points))
    converted.normals = o3d.utility.Vector3dVector(cloud.normals)
    return converted


REACH = 2.0  # largest distance of a point's counterpart, as in spectral/hemisphere.py [voxels]

# Number of points with fully correlated errors along their normals: a neighborhood shares its normal
_CORRELATED = np.pi * NORMAL_REACH**2
_LEAST_SIGMA = 0.05  # smallest standard deviation of a point, for scans that agree exactly [voxels]

_LEAST_FITNESS = 0.1  # share of points in common; unrelated beds laid on each other share up to 0.7
# Share of the common points within half the distance: 0.84..0.95 in right registrations, 0.50..0.81 in wrong ones.
# Voxels smaller than the noise lower it.
_LEAST_CLOSE = 0.83
_LEAST_MATCHES = 20  # of matches that agree: up to 14 in wrong registrations, mostly 21 and more in right ones


@dataclass(frozen=True, slots=True)
class MethodVerdict:
    """Whether a method accepts its result, and why."""

    accepted: bool
    reason: str


def verdict(words: str, *wanted: tuple[bool, str]) -> MethodVerdict:
    """A verdict from `words` and conditions with their minimum values; the first unmet one rejects the result."""
    missed = next((least for met, least in wanted if not met), "")
    return MethodVerdict(not missed, f"{words}; wanted at least {missed}" if missed else words)


Solution = tuple[RigidTransform, MethodVerdict]  # T_target_source, and whether to accept it


class PointRegistrar(ABC):
    """Base class of registrars on points: the transform of `solve`, with the covariance and overlap of the points.

    Scans are thinned to one point per voxel of edge `voxel` [m]; all distances are multiples of it.
    """

    def __init__(self, voxel: float) -> None:
        self.voxel = voxel

    def prepare(self, scan: Scan) -> ThinnedCloud:
        """The thinned scan with what `describe` adds. Raises InputError: it has too few points."""
        cloud = thin(scan, self.voxel)
        return replace(cloud, extra=self.describe(cloud))

    def register(self, target: ThinnedCloud, source: ThinnedCloud) -> Registration:
        """Estimate T_target_source."""
        start = perf_counter()
        T_target_source, verdict = self.solve(target, source)
        return Registration(
            T_target_source=T_target_source,
            covariance=covariance(target, source, T_target_source, self.voxel),
            psr=float("nan"),
            overlap=overlap(target, source, T_target_source, REACH * self.voxel),
            accepted=verdict.accepted,
            seconds=perf_counter() - start,
            reason=verdict.reason,
        )

    def describe(self, cloud: ThinnedCloud) -> Any:
        """The value of `ThinnedCloud.extra`."""
        return None

    @abstractmethod
    def solve(self, target: ThinnedCloud, source: ThinnedCloud) -> Solution:
        """Register prepared scans."""


def judge_fit(target: ThinnedCloud, source: ThinnedCloud, T: RigidTransform, voxel: float) -> MethodVerdict:
    """The verdict by the share of points in common and by how close these are (fitness and inlier distance of ICP)."""
    fitness, near = (overlap(target, source, T, reach * voxel) for reach in (REACH, REACH / 2))
    close, far = near / fitness if fitness > 0 else 0.0, REACH * voxel
    return verdict(
        f"{fitness:.0%} of the points are within {far:.3g} m of the other scan, {close:.0%} of these within half",
        (fitness >= _LEAST_FITNESS, f"{_LEAST_FITNESS:.0%}"),
        (close >= _LEAST_CLOSE, f"{_LEAST_CLOSE:.0%} of these"),
    )


def judge_matches(agreeing: int, matches: int, least: int = _LEAST_MATCHES) -> MethodVerdict:
    """The verdict by the number of feature matches that agree with the transform."""
    return verdict(f"{agreeing} of {matches} matched features agree", (agreeing >= least, str(least)))


def overlap(target: ThinnedCloud, source: ThinnedCloud, T_target_source: RigidTransform, reach: float) -> float:
    """The share of points with a counterpart in the other scan within `reach` [m], the smaller of both scans', 0..1."""
    moved = T_target_source.apply(source.points)
    back = T_target_source.inv().apply(target.points)
    return min(_share(target, moved, reach), _share(source, back, reach))


def _share(cloud: ThinnedCloud, points: np.ndarray, reach: float) -> float:
    distance, _ = cloud.tree.query(points, distance_upper_bound=reach)
    return float(np.isfinite(distance).mean())


def covariance(target: ThinnedCloud, source: ThinnedCloud, T_target_source: RigidTransform, voxel: float) -> np.ndarray:
    """The 6x6 covariance of T_target_source, rotation first, body tangent of the source's sensor frame [rad, m].

    It is the inverse of the Gauss-Newton Hessian of the point-to-plane distances over their variance; the standard
    deviation of an unconstrained direction is the size of the scan. Errors that all points share, such as by false
    neighbors, are not modeled: on simulated pairs the normalized squared error has a median of about 15 instead of 6.
    """
    moved = T_target_source.apply(source.points)
    distance, nearest = target.tree.query(moved, distance_upper_bound=REACH * voxel)
    near = np.isfinite(distance)
    normals = target.normals[nearest[near]]
    residuals = np.sum(normals * (moved[near] - target.points[nearest[near]]), axis=1)
    # about the middle of the points: n . (R (w x p + v)) = w . (p x m) + v . m with m = R^T n
    turned = T_target_source.rotation.inv().apply(normals) if len(normals) else normals
    middle = source.points.mean(axis=0)
    J = np.hstack([np.cross(source.points[near] - middle, turned), turned])
    variance = max(float(np.mean(residuals**2)) if len(residuals) else 0.0, (_LEAST_SIGMA * voxel) ** 2)
    extent = float(np.linalg.norm(np.ptp(source.points, axis=0)))
    unknown = np.diag(np.repeat([np.pi, extent], 3) ** -2.0)
    about_middle = np.linalg.inv(J.T @ J / (variance * _CORRELATED) + unknown)
    shift = np.eye(6)  # adjoint of the translation from the source's sensor to the middle
    shift[3:, :3] = np.cross(middle, np.eye(3)).T
    moved_covariance = shift @ about_middle @ shift.T
    return (moved_covariance + moved_covariance.T) / 2
