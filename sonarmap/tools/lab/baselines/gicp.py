"""Generalized ICP (Segal et al. 2009, DOI 10.15607/RSS.2009.V.021), by small_gicp (DOI 10.21105/joss.06948)."""

from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.extras import load_package
from sonarmap.tools.lab.baselines.cloud import ThinnedCloud, silent
from sonarmap.tools.lab.baselines.icp import DISTANCES
from sonarmap.tools.lab.baselines.result import MethodVerdict, PointRegistrar, judge_fit

_NEIGHBORS = 20  # of which a point's covariance is taken
_STEPS = 100
_THREADS = 1  # sums over several differ in their last bits from run to run


class GicpRegistrar(PointRegistrar):
    """GICP from the identity, so for small motions only; the same correspondence distances as ICP's.

    Args:
        voxel: as `PointRegistrar` takes it.

    Raises:
        InputError: the package is not installed.
    """

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
        """From the identity; believed by the share of points in common."""
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
