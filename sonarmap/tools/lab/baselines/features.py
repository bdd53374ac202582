"""Registration by features: fast point feature histograms (Rusu et al. 2009, DOI 10.1109/ROBOT.2009.5152473), matched,
and the transform by RANSAC or by fast global registration (Zhou et al. 2016, DOI 10.1007/978-3-319-46475-6_47), by
Open3D, then ICP from there, with the parameters of Open3D's own example of global registration."""

from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.baselines.cloud import ThinnedCloud, one_thread, quiet, to_open3d
from sonarmap.tools.lab.baselines.icp import iterate
from sonarmap.tools.lab.baselines.result import MethodVerdict, PointRegistrar, judge_matches

Solver = Literal["ransac", "fgr"]

# Of Open3D's example [voxels].
FEATURE_REACH = 5.0
FEATURE_NEIGHBORS = 100
MATCH_REACH = 1.5  # how far apart matched points may be
REFINE = (1.5,)  # correspondence distances of the last ICP; the example's 0.4 is less than the noise here
_EDGE_RATIO = 0.9
_SAMPLES = 3  # matches per hypothesis
_TRIES, _CONFIDENCE = 100_000, 0.999


class FeatureRegistrar(PointRegistrar):
    """Global registration by FPFH, refined by ICP point to plane.

    Args:
        voxel: as `PointRegistrar` takes it.
        solver: what finds the transform from the matched features.
        seed: of its random samples. The same for every pair, so that a pair's result does not hang on others.
    """

    def __init__(self, voxel: float, solver: Solver = "ransac", seed: int = 0) -> None:
        super().__init__(voxel)
        self.solver: Solver = solver
        self.seed = seed

    def describe(self, cloud: ThinnedCloud) -> Any:
        """Open3D's Feature, 33 numbers per point."""
        import open3d as o3d

        near = o3d.geometry.KDTreeSearchParamHybrid(FEATURE_REACH * self.voxel, FEATURE_NEIGHBORS)
        library: Any = o3d.pipelines.registration  # its stubs want an argument that it does not
        with quiet():
            return library.compute_fpfh_feature(to_open3d(cloud), near)

    def solve(self, target: ThinnedCloud, source: ThinnedCloud) -> tuple[RigidTransform, MethodVerdict]:
        """From anywhere; believed by how many matched features agree with it."""
        T = iterate(target, source, self._solve(target, source), [self.voxel * d for d in REFINE], "plane")
        return T, judge_matches(*self._agreeing(target, source, T))

    def _solve(self, target: ThinnedCloud, source: ThinnedCloud) -> RigidTransform:
        import open3d as o3d

        # Open3D has one generator for all; seeded here, its state from before does not matter. It holds 32 bits.
        o3d.utility.random.seed(int(np.random.SeedSequence(self.seed).generate_state(1)[0] % 2**31))
        r, reach = o3d.pipelines.registration, MATCH_REACH * self.voxel
        given = to_open3d(source), to_open3d(target), source.extra, target.extra
        with one_thread():
            if self.solver == "fgr":
                options = r.FastGlobalRegistrationOption(maximum_correspondence_distance=reach)
                result = r.registration_fgr_based_on_feature_matching(*given, options)
            else:
                result = r.registration_ransac_based_on_feature_matching(
                    *given,
                    True,  # mutual matches alone
                    reach,
                    r.TransformationEstimationPointToPoint(False),
                    _SAMPLES,
                    [
                        r.CorrespondenceCheckerBasedOnEdgeLength(_EDGE_RATIO),
                        r.CorrespondenceCheckerBasedOnDistance(reach),
                    ],
                    r.RANSACConvergenceCriteria(_TRIES, _CONFIDENCE),
                )
        return RigidTransform.from_matrix(np.asarray(result.transformation))

    def _agreeing(self, target: ThinnedCloud, source: ThinnedCloud, T_target_source: RigidTransform) -> tuple[int, int]:
        """How many mutual matches lie within MATCH_REACH of each other under the transform, and how many there are."""
        import open3d as o3d

        with one_thread():
            matches = o3d.pipelines.registration.correspondences_from_features(source.extra, target.extra, True)
        i, j = np.asarray(matches).reshape(-1, 2).T
        apart = T_target_source.apply(source.points[i]) - target.points[j]
        return int((np.linalg.norm(apart, axis=1) <= MATCH_REACH * self.voxel).sum()), len(i)
