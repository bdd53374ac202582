"""The statements of docs/conventions.md, in numbers that tell every axis, sign and order from the others."""

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.gtsam_poses import to_values
from sonarmap.slam.graph.known_pose import known_poses
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.tangent import adjoint, propagated
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior

YAW, PITCH, ROLL = 0.7, -0.3, 0.2
T_WORLD_I = RigidTransform.from_components([4.0, -1.0, 2.5], Rotation.from_euler("ZYX", [YAW, PITCH, ROLL]))
T_WORLD_J = RigidTransform.from_components([6.0, 3.0, -0.5], Rotation.from_euler("ZYX", [-0.4, 0.1, 0.5]))
POINT = np.array([1.0, 2.0, -4.0])
XI = np.array([0.1, -0.4, 0.3, 1.0, 2.0, -3.0])  # rotation first
_SKEW = np.tril(np.arange(1.0, 37.0).reshape(6, 6))
COVARIANCE = 1e-5 * (_SKEW @ _SKEW.T / 100 + np.diag([1.0, 2.0, 3.0, 40.0, 50.0, 60.0]))  # rotation first


class TestTransforms:
    def test_the_edge_is_the_target_inverse_times_the_source(self) -> None:
        """A landmark seen from j lies, through the edge, where i sees it; GTSAM's `between` says the same."""
        T_i_j = T_WORLD_I.inv() * T_WORLD_J
        seen_from_i, seen_from_j = (T.inv().apply(POINT) for T in (T_WORLD_I, T_WORLD_J))
        np.testing.assert_allclose(T_i_j.apply(seen_from_j), seen_from_i, atol=1e-14)
        between = gtsam.Pose3(T_WORLD_I.as_matrix()).between(gtsam.Pose3(T_WORLD_J.as_matrix()))
        np.testing.assert_allclose(T_i_j.as_matrix(), between.matrix(), atol=1e-14)
        # a trajectory stacks poses in the world
        trajectory = Trajectory(np.array([10.0, 20.0]), RigidTransform.concatenate([T_WORLD_I, T_WORLD_J]))
        np.testing.assert_array_equal(trajectory.T_world_sensor[1].as_matrix(), T_WORLD_J.as_matrix())


class TestAngles:
    def test_the_rotation_is_yaw_times_pitch_times_roll(self) -> None:
        cy, sy, cp, sp, cr, sr = (f(a) for a in (YAW, PITCH, ROLL) for f in (np.cos, np.sin))
        Rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        Ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        Rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        np.testing.assert_allclose(T_WORLD_I.rotation.as_matrix(), Rz @ Ry @ Rx, atol=1e-14)
        np.testing.assert_allclose(T_WORLD_I.rotation.as_euler("ZYX"), [YAW, PITCH, ROLL], atol=1e-14)
        np.testing.assert_allclose(gtsam.Rot3.RzRyRx(ROLL, PITCH, YAW).matrix(), Rz @ Ry @ Rx, atol=1e-14)


class TestUncertainty:
    def test_the_tangent_is_rotation_first(self) -> None:
        np.testing.assert_allclose(
            RigidTransform.from_exp_coords(XI).as_matrix(), gtsam.Pose3.Expmap(XI).matrix(), atol=1e-14
        )
        only_rotation = RigidTransform.from_exp_coords([0, 0, 0.5, 0, 0, 0])
        np.testing.assert_allclose(only_rotation.rotation.as_rotvec(), [0, 0, 0.5], atol=1e-15)
        np.testing.assert_array_equal(only_rotation.translation, np.zeros(3))

    def test_the_perturbation_is_on_the_right(self) -> None:
        """T Exp(xi), in the frame of the source, is GTSAM's retraction; Exp(xi) T is another transform."""
        retracted = gtsam.Pose3(T_WORLD_I.as_matrix()).retract(XI).matrix()
        right = T_WORLD_I * RigidTransform.from_exp_coords(XI)
        left = RigidTransform.from_exp_coords(XI) * T_WORLD_I
        np.testing.assert_allclose(right.as_matrix(), retracted, atol=1e-14)
        assert np.abs(left.as_matrix() - retracted).max() > 0.1

    def test_the_error_of_a_between_factor_is_of_that_tangent(self) -> None:
        """Where the poses say T Exp(xi) and the factor measured T, the unwhitened error is xi."""
        T_i_j = T_WORLD_I.inv() * T_WORLD_J
        measured, noise = gtsam.Pose3(T_i_j.as_matrix()), gtsam.noiseModel.Unit.Create(6)
        values = gtsam.Values()
        values.insert(1, gtsam.Pose3(T_WORLD_I.as_matrix()))
        values.insert(2, gtsam.Pose3((T_WORLD_J * RigidTransform.from_exp_coords(XI)).as_matrix()))
        error = gtsam.BetweenFactorPose3(1, 2, measured, noise).unwhitenedError(values)
        np.testing.assert_allclose(error, XI, atol=1e-12)


class TestPoseGraph:
    def measured(self, xi: np.ndarray) -> PoseGraph:
        """Two poses and one edge, which says that j is off by xi."""
        T_i_j = T_WORLD_I.inv() * T_WORLD_J * RigidTransform.from_exp_coords(xi).inv()
        edge = Edge(0, 1, Registration(T_i_j, COVARIANCE, 9.0, 0.5, True, 0.1), "sequential")
        poses = RigidTransform.concatenate([T_WORLD_I, T_WORLD_J])
        return PoseGraph(Trajectory(np.arange(2.0), poses), (edge,))

    def test_an_edge_has_the_covariance_of_its_registration(self) -> None:
        residual = self.measured(XI).residuals()[0]
        assert residual**2 == pytest.approx(XI @ np.linalg.solve(COVARIANCE, XI), rel=1e-9)

    def test_a_pose_has_that_of_its_own_tangent_against_the_first(self) -> None:
        """Of a chain of one edge all three are the edge's own: the pose's, and that of T_i_j, without turning."""
        solution = self.measured(np.zeros(6)).optimize()
        np.testing.assert_allclose(solution.covariances()[1], COVARIANCE, rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose(solution.relative(0, 1)[1], COVARIANCE, rtol=1e-4, atol=1e-9)
        assert np.abs(solution.covariances()[0]).max() < 1e-11

    def test_the_adjoint_carries_a_tangent_to_the_left(self) -> None:
        Exp = RigidTransform.from_exp_coords
        left = Exp(adjoint(T_WORLD_I) @ (XI / 10)) * T_WORLD_I
        np.testing.assert_allclose((T_WORLD_I * Exp(XI / 10)).as_matrix(), left.as_matrix(), atol=1e-12)
        A = gtsam.Pose3(T_WORLD_I.as_matrix()).AdjointMap()
        np.testing.assert_allclose(propagated(T_WORLD_I, COVARIANCE), A @ COVARIANCE @ A.T, atol=1e-12)

    def test_a_prior_weighs_its_own_errors(self) -> None:
        """Of R_true = Exp(w) R_measured with w = Rz(h) (roll, pitch, heading error), as the page has it."""
        errors, sigmas = np.array([0.02, -0.05, 0.03, 4.0, -2.0, 0.5]), np.array([0.01, 0.02, 0.04, 3.0, 5.0, 0.2])
        quaternion = T_WORLD_I.rotation.as_quat()
        h = 2 * np.arctan2(quaternion[2], quaternion[3])
        w = Rotation.from_euler("Z", h).apply(errors[:3])
        true = RigidTransform.from_components(
            T_WORLD_I.translation + errors[3:], Rotation.from_rotvec(w) * T_WORLD_I.rotation
        )
        poses = RigidTransform.concatenate([true])
        for known in (np.ones(6, bool), np.array([True, True, True, False, False, True])):
            prior = PosePrior(T_WORLD_I, np.where(known, sigmas, np.inf))
            (measured,) = known_poses({0: prior}, poses)
            squared = 2 * sum(factor.error(to_values(poses)) for factor in measured.factors())
            assert squared == pytest.approx((errors / sigmas)[known] @ (errors / sigmas)[known], rel=1e-9)
