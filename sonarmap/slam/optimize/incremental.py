"""A pose graph that grows scan by scan, kept at its optimum: GTSAM's iSAM2.

Kaess, Johannsson, Roberts, Ila, Leonard and Dellaert, IJRR 2012, DOI 10.1177/0278364911430419.
"""

from collections import defaultdict
from collections.abc import Sequence

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.factors import edge_factors
from sonarmap.slam.graph.gtsam_poses import to_pose3, to_transforms
from sonarmap.slam.graph.known_pose import GAUGE_SIGMA
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.tangent import adjoint
from sonarmap.slam.graph.trajectory import Trajectory

# Every pose is linearized again at every step, where it moved by more than this [rad, m], and every step is followed by
# more: the answer is the batch optimum, at the price of some speed.
_RELINEARIZE = 1e-4
_STEPS = 3


class Incremental:
    """Poses 0, 1, 2, ... as they come, each with the edges that tie it to earlier ones.

    The first pose is held at the identity unless it comes with a prior.
    """

    def __init__(self) -> None:
        settings = gtsam.ISAM2Params()
        settings.setRelinearizeThreshold(_RELINEARIZE)
        settings.relinearizeSkip = 1
        self._isam = gtsam.ISAM2(settings)
        self._values = gtsam.Values()
        self._stamps: list[float] = []

    def __len__(self) -> int:
        return len(self._stamps)

    def add_pose(self, stamp: float, edges: Sequence[Edge] = ()) -> int:
        """Add the next pose with its edges, and give its index.

        It starts where its first edge puts it.

        Args:
            stamp: its time [s].
            edges: measurements between poses that are there and this one, at least one of which names it; none for the
                first pose, or priors.

        Raises:
            InputError: an edge that names a pose that is not there, or none that names this one.
        """
        pose = len(self)
        own = [edge for edge in edges if pose in (edge.i, edge.j)]
        if pose and not own:
            raise InputError(f"no edge ties pose {pose} to the others; give it one, or start another Incremental")
        self._require_known(edges, pose)
        factors = gtsam.NonlinearFactorGraph()
        if not own:
            factors.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, GAUGE_SIGMA)))
        for factor in edge_factors(edges):
            factors.add(factor)
        started = gtsam.Values()
        started.insert(pose, to_pose3(self._start(pose, own)))
        self._stamps.append(stamp)
        self._update(factors, started)
        return pose

    def add_edges(self, edges: Sequence[Edge]) -> None:
        """Add measurements between poses that are there, as loops found later.

        Raises:
            InputError: an edge that names a pose that is not there.
        """
        self._require_known(edges, len(self) - 1)
        factors = gtsam.NonlinearFactorGraph()
        for factor in edge_factors(edges):
            factors.add(factor)
        self._update(factors, gtsam.Values())

    @property
    def trajectory(self) -> Trajectory:
        """The poses as all edges so far have them."""
        return Trajectory(np.array(self._stamps), to_transforms(self._values, len(self)))

    def relative(self, i: int, j: int) -> tuple[RigidTransform, np.ndarray]:
        """T_i_j and its (6, 6) covariance, rotation first [rad, m], body tangent of j; as of `Solution.relative`."""
        poses = [RigidTransform.from_matrix(self._values.atPose3(pose).matrix()) for pose in (i, j)]
        T_i_j = poses[0].inv() * poses[1]
        joint = self._isam.jointMarginalCovariance([i, j])
        stacked = np.block([[joint.at(a, b) for b in (i, j)] for a in (i, j)])
        jacobian = np.hstack([-adjoint(T_i_j.inv()), np.eye(6)])
        return T_i_j, jacobian @ stacked @ jacobian.T

    def _start(self, pose: int, own: Sequence[Edge]) -> RigidTransform:
        if not own:
            return RigidTransform.identity()
        first = own[0]
        T = first.registration.T_target_source
        if first.kind == "prior":
            return T
        other = first.j if first.i == pose else first.i
        T_world_other = RigidTransform.from_matrix(self._values.atPose3(other).matrix())
        return T_world_other * (T.inv() if first.i == pose else T)

    def _require_known(self, edges: Sequence[Edge], last: int) -> None:
        strange = next((edge for edge in edges if max(edge.i, edge.j) > last), None)
        if strange is not None:
            raise InputError(f"{strange.name} names a pose which is not among the {last + 1} so far")

    def _update(self, factors: gtsam.NonlinearFactorGraph, started: gtsam.Values) -> None:
        try:
            self._isam.update(factors, started)
            for _ in range(_STEPS):
                self._isam.update()
            self._values = self._isam.calculateBestEstimate()
        except RuntimeError as error:
            raise InputError(
                f"the pose graph of {len(self)} poses has no unique solution ({str(error).strip().splitlines()[0]}); "
                "look for covariances that are far too large or too small"
            ) from error


def as_they_come(graph: PoseGraph) -> RigidTransform:
    """The N poses of a graph as they are when its last one has come: each is added with its edges to earlier ones.

    Raises:
        InputError: a pose that no edge ties to an earlier one.
    """
    arriving: dict[int, list[Edge]] = defaultdict(list)
    for edge in graph.edges:
        arriving[max(edge.i, edge.j)].append(edge)
    growing = Incremental()
    for pose, stamp in enumerate(graph.trajectory.stamps.tolist()):
        growing.add_pose(stamp, arriving[pose])
    return growing.trajectory.T_world_sensor
