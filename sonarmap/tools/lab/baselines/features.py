"""Global registration by features, refined by point-to-plane ICP.

Open3D, with the parameters of its example: fast point feature histograms (Rusu et al. 2009, DOI
10.1109/ROBOT.2009.5152473), and the transform by RANSAC. KISS-Matcher (Lim et al. 2024, arXiv 2409.15615): graph
pruning and a robust solver.
"""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.extras import load_package
from sonarmap.tools.lab.baselines.icp import iterate
from sonarmap.tools.lab.baselines.points import PointRegistrar, Solution, ThinnedCloud, judge_matches, quiet, to_open3d

FEATURE_REACH = 5.0  # radius of the neighborhood of a feature [voxels]
FEATURE_NEIGHBORS = 100  # largest number of points in it
MATCH_REACH = 1.5  # largest distance between matched points [voxels]
REFINE = (1.5,)  # correspondence distances of the final ICP [voxels]; the 0.4 of the example is below the noise here
_EDGE_RATIO = 0.9  # smallest ratio of the lengths of corresponding edges
_SAMPLES = 3  # matches per hypothesis
_TRIES = 100_000  # largest number of hypotheses
_CONFIDENCE = 0.999  # probability at which RANSAC ends


class FeatureRegistrar(PointRegistrar):
    """FPFH features; every pair starts from the same random seed, so its result does not depend on other pairs."""

    def __init__(self, voxel: float, seed: int = 0) -> None:
        super().__init__(voxel)
        self.seed = seed

    def describe(self, cloud: ThinnedCloud) -> Any:
        """Open3D's Feature, with 33 numbers per point."""
        import open3d as o3d

        near = o3d.geometry.KDTreeSearchParamHybrid(FEATURE_REACH * self.voxel, FEATURE_NEIGHBORS)
        library: Any = o3d.pipelines.registration  # its stubs require an argument that the function does not
        with quiet():
            return library.compute_fpfh_feature(to_open3d(cloud), near)

    def solve(self, target: ThinnedCloud, source: ThinnedCloud) -> Solution:
        """Registration without an initial pose, accepted by the number of feature matches that agree with it."""
        T = iterate(target, source, self._solve(target, source), [self.voxel * d for d in REFINE], "plane")
        return T, judge_matches(*self._agreeing(target, source, T))

    def _solve(self, target: ThinnedCloud, source: ThinnedCloud) -> RigidTransform:
        import open3d as o3d

        # Open3D has one global generator; seeding it here discards its earlier state. The seed is a 32-bit integer.
        o3d.utility.random.seed(int(np.random.SeedSequence(self.seed).generate_state(1)[0] % 2**31))
        r, reach = o3d.pipelines.registration, MATCH_REACH * self.voxel
        inputs = to_open3d(source), to_open3d(target), source.extra, target.extra
        with quiet(one_thread=True):
            result = r.registration_ransac_based_on_feature_matching(
                *inputs,
                True,  # only mutual matches
                reach,
                r.TransformationEstimationPointToPoint(False),
                _SAMPLES,
                [r.CorrespondenceCheckerBasedOnEdgeLength(_EDGE_RATIO), r.CorrespondenceCheckerBasedOnDistance(reach)],
                r.RANSACConvergenceCriteria(_TRIES, _CONFIDENCE),
            )
        return RigidTransform.from_matrix(np.asarray(result.transformation))

    def _agreeing(self, target: ThinnedCloud, source: ThinnedCloud, T_target_source: RigidTransform) -> tuple[int, int]:
        """Number of mutual matches within MATCH_REACH of each other under the transform, and of all mutual matches."""
        import open3d as o3d

        with quiet(one_thread=True):
            matches = o3d.pipelines.registration.correspondences_from_features(source.extra, target.extra, True)
        i, j = np.asarray(matches).reshape(-1, 2).T
        apart = T_target_source.apply(source.points[i]) - target.points[j]
        return int((np.linalg.norm(apart, axis=1) <= MATCH_REACH * self.voxel).sum()), len(i)


_STDOUT = 1  # file descriptor


@contextmanager
def silent() -> Iterator[None]:
    """Discard what Python, C and C++ write to the standard output."""
    sys.stdout.flush()
    kept, nowhere = os.dup(_STDOUT), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, _STDOUT)
    try:
        yield
    finally:
        ctypes.CDLL(None).fflush(None)  # C buffers its output if stdout is not a terminal
        os.dup2(kept, _STDOUT)
        os.close(kept)
        os.close(nowhere)


_LEAST_INLIERS = 10  # KISS-Matcher finds 14..53 in right registrations, 0 or 1 in wrong ones
_FEWEST_MATCHES = 3  # that determine a transform
# KISS-Matcher ends the process if no point has enough neighbors
_NEIGHBORS = 5
_NEIGHBOR_REACH = 3.0  # [voxels]
_FEWEST_POINTS = 10  # with _NEIGHBORS neighbors within _NEIGHBOR_REACH


class KissRegistrar(PointRegistrar):
    """KISS-Matcher, which processes both scans at once: the seconds of a pair include the features of both.

    Its thinning, which orders points randomly, is not used, and its noise bounds are not clamped to 1 m, which may be
    less than a voxel. Raises InputError: the package is not installed.
    """

    def __init__(self, voxel: float) -> None:
        super().__init__(voxel)
        self._kiss = load_package("kiss_matcher", "kiss-matcher", "the method kiss", "peers")

    def solve(self, target: ThinnedCloud, source: ThinnedCloud) -> Solution:
        """Registration without an initial pose, accepted by the number of inliers."""
        T, inliers, matches = self._match(target, source)
        T = iterate(target, source, T, [self.voxel * d for d in REFINE], "plane")
        return T, judge_matches(inliers, matches, _LEAST_INLIERS)

    def _match(self, target: ThinnedCloud, source: ThinnedCloud) -> tuple[RigidTransform, int, int]:
        """The transform, the number of its inliers, and the number of all matches."""
        if min(self._dense(target), self._dense(source)) < _FEWEST_POINTS:
            return RigidTransform.identity(), 0, 0
        settings = self._kiss.KISSMatcherConfig(
            voxel_size=self.voxel, use_voxel_sampling=False, enable_noise_bound_clamping=False
        )
        with silent():
            matcher = self._kiss.KISSMatcher(settings)
            moving, fixed = (np.array(points) for points in matcher.match(source.points.T, target.points.T))
            if len(moving) < _FEWEST_MATCHES:
                return RigidTransform.identity(), 0, len(moving)
            solution = matcher.prune_and_solve(moving, fixed)
        if not solution.valid:
            return RigidTransform.identity(), 0, len(moving)
        R = Rotation.from_matrix(np.asarray(solution.rotation))
        T = RigidTransform.from_components(np.asarray(solution.translation).ravel(), R)
        return T, int(matcher.get_num_final_inliers()), len(moving)

    def _dense(self, cloud: ThinnedCloud) -> int:
        """Number of points with enough neighbors for a feature."""
        distance, _ = cloud.tree.query(cloud.points, [_NEIGHBORS + 1])  # the nearest is the point itself
        return int((distance <= _NEIGHBOR_REACH * self.voxel).sum())
