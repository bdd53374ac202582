"""Generalized ICP (Segal et al. 2009, DOI 10.15607/RSS.2009.V.021), by small_gicp (DOI 10.21105/joss.06948)."""

from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.extras import load_package
from sonarmap.tools.lab.baselines.cloud import ThinnedCloud, silent, thin
from sonarmap.tools.lab.baselines.icp import DISTANCES
from sonarmap.tools.lab.baselines.result import conclude, judge_fit

_NEIGHBORS = 20  # of which a point's covariance is taken
_STEPS = 100
_THREADS = 1  # sums over several differ in their last bits from run to run


@dataclass(frozen=True, slots=True)
class Shaped:
    """A thinned scan with a covariance for every point.

    Attributes:
        cloud: the points.
        points, tree: small_gicp's PointCloud and KdTree.
    """

    cloud: ThinnedCloud
    points: Any
    tree: Any


class GicpRegistrar:
    """GICP from the identity, so for small motions only; the same correspondence distances as ICP's.

    Args:
        voxel: edge of the voxels to which scans are thinned [m].

    Raises:
        InputError: the package is not installed.
    """

    def __init__(self, voxel: float) -> None:
        self.voxel = voxel
        self._gicp = load_package("small_gicp", "small_gicp", "the method gicp", "peers")

    def prepare(self, scan: Scan) -> Shaped:
        """The scan's points, one per voxel, and their covariances.

        Raises:
            InputError: they are too few.
        """
        cloud = thin(scan, self.voxel)
        points = self._gicp.PointCloud(cloud.points)
        tree = self._gicp.KdTree(points, num_threads=_THREADS)
        self._gicp.estimate_normals_covariances(points, tree, num_neighbors=_NEIGHBORS, num_threads=_THREADS)
        return Shaped(cloud, points, tree)

    def register(self, target: Shaped, source: Shaped) -> Registration:
        """Find T_target_source from the identity; `accepted` by the share of points in common."""
        start = perf_counter()
        T = np.eye(4)
        with silent():
            for distance in DISTANCES:
                T = self._gicp.align(
                    target.points,
                    source.points,
                    target.tree,
                    T,
                    max_correspondence_distance=distance * self.voxel,
                    num_threads=_THREADS,
                    max_iterations=_STEPS,
                ).T_target_source
        T_target_source = RigidTransform.from_matrix(T)
        verdict = judge_fit(target.cloud, source.cloud, T_target_source, self.voxel)
        return conclude(target.cloud, source.cloud, T_target_source, self.voxel, verdict, start)
