"""Iterative closest point from the identity (paper Sect. 4.2): Open3D's point to point (Besl and McKay 1992, DOI
10.1109/34.121791) and point to plane (Chen and Medioni 1992, DOI 10.1016/0262-8856(92)90066-C), and small_gicp's
generalized ICP (Segal, Haehnel and Thrun 2009, DOI 10.15607/RSS.2009.V.021)."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.extras import load_package
from sonarmap.tools.lab.baselines.points import PointRegistrar, Solution, ThinnedCloud, judge_fit, quiet, to_open3d

Kind = Literal["point", "plane"]

DISTANCES = (16.0, 8.0, 4.0, 2.0)  # largest distance between correspondences in each round [voxels]
_CONVERGED = 1e-6  # relative change of fitness and rms distance at which a round ends
_STEPS = 100  # largest number of iterations of a round


class IcpRegistrar(PointRegistrar):
    """ICP from the identity, so for small motions only; `kind` selects distances to the nearest point or its plane."""

    def __init__(self, voxel: float, kind: Kind = "point") -> None:
        super().__init__(voxel)
        self.kind: Kind = kind

    def solve(self, target: ThinnedCloud, source: ThinnedCloud) -> Solution:
        """Registration from the identity, accepted by the share of points in common."""
        T = iterate(target, source, RigidTransform.identity(), [self.voxel * d for d in DISTANCES], self.kind)
        return T, judge_fit(target, source, T, self.voxel)


def iterate(
    target: ThinnedCloud, source: ThinnedCloud, T_target_source: RigidTransform, distances: Sequence[float], kind: Kind
) -> RigidTransform:
    """The T_target_source that ICP finds from an initial one, with a round for each correspondence distance [m].

    Point to plane uses one thread, as the order of Open3D's sums over several threads changes from run to run.
    """
    import open3d as o3d

    icp = o3d.pipelines.registration
    to_plane = kind == "plane"
    estimation = icp.TransformationEstimationPointToPlane() if to_plane else icp.TransformationEstimationPointToPoint()
    criteria = icp.ICPConvergenceCriteria(_CONVERGED, _CONVERGED, _STEPS)
    fixed, moving, T = to_open3d(target), to_open3d(source), T_target_source.as_matrix()
    with quiet(one_thread=to_plane):
        for distance in distances:
            T = np.asarray(icp.registration_icp(moving, fixed, distance, T, estimation, criteria).transformation)
    return RigidTransform.from_matrix(T)


class GicpRegistrar(PointRegistrar):
    """small_gicp's generalized ICP from the identity. Raises InputError: the package is not installed."""

    def __init__(self, voxel: float) -> None:
        super().__init__(voxel)
        self._gicp = load_package("small_gicp", "small-gicp", "the method gicp", "peers")

    def describe(self, cloud: ThinnedCloud) -> Any:
        """The points with covariances of their neighborhoods, and their tree."""
        points = self._gicp.PointCloud(cloud.points)
        tree = self._gicp.KdTree(points)
        self._gicp.estimate_covariances(points, tree)
        return points, tree

    def solve(self, target: ThinnedCloud, source: ThinnedCloud) -> Solution:
        """Registration from the identity, accepted by the share of points in common."""
        (fixed, tree), (moving, _), T = target.extra, source.extra, np.eye(4)
        for distance in DISTANCES:
            reach = self.voxel * distance
            T = self._gicp.align(fixed, moving, tree, T, max_correspondence_distance=reach).T_target_source
        found = RigidTransform.from_matrix(T)
        return found, judge_fit(target, source, found, self.voxel)
