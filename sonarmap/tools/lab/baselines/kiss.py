"""KISS-Matcher (Lim et al. 2024, arXiv 2409.15615): features, graph pruning and a robust solver, then ICP."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.extras import load_package
from sonarmap.tools.lab.baselines.cloud import ThinnedCloud, silent
from sonarmap.tools.lab.baselines.features import REFINE
from sonarmap.tools.lab.baselines.icp import iterate
from sonarmap.tools.lab.baselines.result import MethodVerdict, PointRegistrar, judge_matches

# Matches that survive both prunings: 14..53 where right, 0 or 1 where wrong; its authors' examples want 5.
_LEAST_INLIERS = 10
_FEWEST_MATCHES = 3  # that fix a transform
# A point takes part that has a few others within three voxels; where none does the package ends the whole program.
_NEIGHBORS, _NEIGHBOR_REACH, _FEWEST_POINTS = 5, 3.0, 10


class KissRegistrar(PointRegistrar):
    """Global registration by KISS-Matcher, refined by ICP point to plane.

    The package works on both scans of a pair at once, so that a pair's seconds hold the features of both. Its own
    thinning, which orders the points by chance, is not used.

    Args:
        voxel: edge of the voxels to which scans are thinned [m]; the package's distances are its multiples of it. Its
            bounds on the noise are not clamped to 1 m as is its default, lest they be less than the voxel.

    Raises:
        InputError: the package is not installed.
    """

    def __init__(self, voxel: float) -> None:
        super().__init__(voxel)
        self._kiss = load_package("kiss_matcher", "kiss-matcher", "the method kiss", "peers")

    def solve(self, target: ThinnedCloud, source: ThinnedCloud) -> tuple[RigidTransform, MethodVerdict]:
        """From anywhere; believed by how many matches were left."""
        T, inliers, matches = self._match(target, source)
        T = iterate(target, source, T, [self.voxel * d for d in REFINE], "plane")
        return T, judge_matches(inliers, matches, _LEAST_INLIERS)

    def _match(self, target: ThinnedCloud, source: ThinnedCloud) -> tuple[RigidTransform, int, int]:
        """The transform, how many matches agree with it, how many there were."""
        if min(self._dense(target), self._dense(source)) < _FEWEST_POINTS:
            return RigidTransform.identity(), 0, 0
        settings = self._kiss.KISSMatcherConfig(
            voxel_size=self.voxel, use_voxel_sampling=False, enable_noise_bound_clamping=False
        )
        with silent():
            matcher = self._kiss.KISSMatcher(settings)
            moving, fixed = (np.array(one) for one in matcher.match(source.points.T, target.points.T))
            if len(moving) < _FEWEST_MATCHES:
                return RigidTransform.identity(), 0, len(moving)
            solution = matcher.prune_and_solve(moving, fixed)
        if not solution.valid:
            return RigidTransform.identity(), 0, len(moving)
        R = Rotation.from_matrix(np.asarray(solution.rotation))
        T = RigidTransform.from_components(np.asarray(solution.translation).ravel(), R)
        return T, int(matcher.get_num_final_inliers()), len(moving)

    def _dense(self, cloud: ThinnedCloud) -> int:
        """How many points have neighbors enough for a feature."""
        distance, _ = cloud.tree.query(cloud.points, [_NEIGHBORS + 1])  # a point is its own first
        return int((distance <= _NEIGHBOR_REACH * self.voxel).sum())
