"""The iterative closest point, point to point (Besl and McKay 1992, DOI 10.1109/34.121791) or point to plane (Chen and
Medioni 1992, DOI 10.1016/0262-8856(92)90066-C), by Open3D, from the identity as in Sect. 4.2 of the paper; generalized
ICP (Segal et al. 2009, DOI 10.15607/RSS.2009.V.021) by small_gicp (DOI 10.21105/joss.06948)."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.extras import load_package
from sonarmap.tools.lab.baselines.points import (
    MethodVerdict,
    PointRegistrar,
    ThinnedCloud,
    judge_fit,
    one_thread,
    quiet,
    silent,
    to_open3d,
)

Kind = Literal["point", "plane"]

DISTANCES = (16.0, 8.0, 4.0, 2.0)  # of correspondences, round by round [voxels]
_CONVERGED = 1e-6  # relative change of fitness and rms distance at which a round ends
_STEPS = 100  # of a round, at most


class IcpRegistrar(PointRegistrar):
    """ICP from the identity, so for small motions only; `kind` is what distances are to, the nearest point or plane."""

    def __init__(self, voxel: float, kind: Kind = "point") -> None:
        super().__init__(voxel)
        self.kind: Kind = kind

    def solve(self, target: ThinnedCloud, source: ThinnedCloud) -> tuple[RigidTransform, MethodVerdict]:
        """From the identity; accepted by the share of points in common."""
        T = iterate(target, source, RigidTransform.identity(), [self.voxel * d for d in DISTANCES], self.kind)
        return T, judge_fit(target, source, T, self.voxel)


def iterate(
    target: ThinnedCloud, source: ThinnedCloud, T_target_source: RigidTransform, distances: Sequence[float], kind: Kind
) -> RigidTransform:
    """The T_target_source to which ICP leads from a given one, a round for each correspondence distance [m].

    One thread for point to plane: Open3D sums by threads there, in an order that changes from run to run.
    """
    import open3d as o3d

    icp = o3d.pipelines.registration
    to_plane = kind == "plane"
    estimation = icp.TransformationEstimationPointToPlane() if to_plane else icp.TransformationEstimationPointToPoint()
    criteria = icp.ICPConvergenceCriteria(_CONVERGED, _CONVERGED, _STEPS)
    fixed, moving, T = to_open3d(target), to_open3d(source), T_target_source.as_matrix()
    with one_thread() if to_plane else quiet():
        for distance in distances:
            T = np.asarray(icp.registration_icp(moving, fixed, distance, T, estimation, criteria).transformation)
    return RigidTransform.from_matrix(T)


_NEIGHBORS = 20  # of which a point's covariance is taken
_THREADS = 1  # sums over several differ in their last bits from run to run


class GicpRegistrar(PointRegistrar):
    """GICP from the identity, by ICP's distances. Raises InputError: the package is not installed."""

    def __init__(self, voxel: float) -> None:
        super().__init__(voxel)
        self._gicp = load_package("small_gicp", "small_gicp", "the method gicp", "peers")

    def describe(self, cloud: ThinnedCloud) -> Any:
        """small_gicp's PointCloud, with a covariance for every point, and its KdTree."""
        points = self._gicp.PointCloud(cloud.points)
        tree = self._gicp.KdTree(points, num_threads=_THREADS)
        self._gicp.estimate_normals_covariances(points, tree, num_neighbors=_NEIGHBORS, num_threads=_THREADS)
        return points, tree

    def solve(self, target: ThinnedCloud, source: ThinnedCloud) -> tuple[RigidTransform, MethodVerdict]:
        """From the identity; accepted by the share of points in common."""
        (fixed, tree), (moving, _), T = target.extra, source.extra, np.eye(4)
        with silent():
            for distance in DISTANCES:
                T = self._gicp.align(
                    fixed,
                    moving,
                    tree,
                    T,
                    max_correspondence_distance=distance * self.voxel,
                    num_threads=_THREADS,
                    max_iterations=_STEPS,
                ).T_target_source
        T_target_source = RigidTransform.from_matrix(T)
        return T_target_source, judge_fit(target, source, T_target_source, self.voxel)
