"""The iterative closest point, point to point (Besl and McKay 1992, DOI 10.1109/34.121791) or point to plane (Chen and
Medioni 1992, DOI 10.1016/0262-8856(92)90066-C), by Open3D, from the identity as in Sect. 4.2 of the paper."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.baselines.cloud import ThinnedCloud, one_thread, quiet, to_open3d
from sonarmap.tools.lab.baselines.result import MethodVerdict, PointRegistrar, judge_fit

Kind = Literal["point", "plane"]

# How far apart points may be that are taken for the same, one round after the other [voxels]: first wide enough to be
# drawn in from some way off, last no wider than what the noise and the thinning leave.
DISTANCES = (16.0, 8.0, 4.0, 2.0)
# A round ends when fitness and rms distance change by less than this share, or after so many steps.
_CONVERGED = 1e-6
_STEPS = 100


class IcpRegistrar(PointRegistrar):
    """ICP from the identity, so for small motions only.

    Args:
        voxel: as `PointRegistrar` takes it.
        kind: what is made small: the distance to the nearest point, or to its plane.
    """

    def __init__(self, voxel: float, kind: Kind = "point") -> None:
        super().__init__(voxel)
        self.kind: Kind = kind

    def solve(self, target: ThinnedCloud, source: ThinnedCloud) -> tuple[RigidTransform, MethodVerdict]:
        """From the identity; believed by the share of points in common."""
        T = iterate(target, source, RigidTransform.identity(), [self.voxel * d for d in DISTANCES], self.kind)
        return T, judge_fit(target, source, T, self.voxel)


def iterate(
    target: ThinnedCloud, source: ThinnedCloud, T_target_source: RigidTransform, distances: Sequence[float], kind: Kind
) -> RigidTransform:
    """The T_target_source to which ICP leads from the given one, one round for each correspondence distance [m].

    The same input gives the same bytes. Point to point takes all threads, which seek the nearest points; for point to
    plane Open3D also sums by threads, in an order that is not always the same, so that it gets one.
    """
    import open3d as o3d

    icp = o3d.pipelines.registration
    estimation = {
        "point": lambda: icp.TransformationEstimationPointToPoint(),
        "plane": lambda: icp.TransformationEstimationPointToPlane(),
    }[kind]()
    criteria = icp.ICPConvergenceCriteria(_CONVERGED, _CONVERGED, _STEPS)
    fixed, moving, T = to_open3d(target), to_open3d(source), T_target_source.as_matrix()
    with one_thread() if kind == "plane" else quiet():
        for distance in distances:
            T = np.asarray(icp.registration_icp(moving, fixed, distance, T, estimation, criteria).transformation)
    return RigidTransform.from_matrix(T)
