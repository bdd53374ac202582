"""The priors of two scans, and how far a relative pose is from what they measured."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.geometry import cross_matrices, measured_rotation, rotation_covariance, twist
from sonarmap.spectral.scan import PosePrior


@dataclass(frozen=True, slots=True)
class PriorPair:
    """The priors of two scans, in one world."""

    target: PosePrior
    source: PosePrior

    @property
    def knows_tilt(self) -> bool:
        """Whether the relative rotation is known but for a turn about the vertical."""
        return self.target.knows_attitude and self.source.knows_attitude

    @property
    def knows_heading(self) -> bool:
        """Whether the turn about the vertical is bounded: narrowly with `knows_tilt`, else widely."""
        return self.target.knows_heading and self.source.knows_heading

    @property
    def knows_position(self) -> bool:
        """Whether the horizontal shift is measured."""
        return self.target.knows_position and self.source.knows_position

    @property
    def knows_depth(self) -> bool:
        """Whether the vertical shift is measured."""
        return self.target.knows_depth and self.source.knows_depth

    @property
    def R_target_source(self) -> Rotation | None:
        """The measured relative rotation; None where attitude and heading are not known in both scans."""
        if not (self.knows_tilt and self.knows_heading):
            return None
        return self.target.T_world_sensor.rotation.inv() * self.source.T_world_sensor.rotation

    @property
    def measures(self) -> bool:
        """Whether anything is measured in full, and `residuals` counts it."""
        return bool(self._known(self.source if self._is_backward else self.target).any())

    def normalized(self, T_target_source: RigidTransform) -> tuple[float, int]:
        """How far a relative pose is from what was measured: chi-squared, and its degrees of freedom.

        Counted is what `residuals` has: (0.0, 0) where nothing is measured in full.
        """
        one = RigidTransform.concatenate([T_target_source])
        residual, covariance = self.residuals(one)[0], self.residual_covariance(one)[0]
        return float(residual @ np.linalg.solve(covariance, residual)), len(residual)

    def residuals(self, T_target_source: RigidTransform) -> np.ndarray:
        """What relative poses differ by from what was measured, in the world's axes.

        Counted are the tilt (2) and the turn (1) where both attitudes are known, the height (1) where an attitude is
        known, and the horizontal shift (2) where a heading is known with it. What only bounds is not counted.

        Returns:
            Of a stack of N (N, k) [rad, m], in the order tilt, tilt, turn, East, North, Up; k <= 6 are measured.
        """
        if self._is_backward:
            return PriorPair(self.source, self.target).residuals(T_target_source.inv())
        tilt, turn = self._turn(T_target_source.rotation)
        d = measured_rotation(self.target).apply(T_target_source.translation)
        residual = np.column_stack([tilt, turn, d - self._shift])
        return residual[:, self._known(self.target)]

    def residual_covariance(self, T_target_source: RigidTransform) -> np.ndarray:
        """The covariance (N, k, k) of N relative poses' `residuals`, each as if it were the true pose.

        An error of the attitude that turns the scan and its shift alike is counted once.
        """
        if self._is_backward:
            return PriorPair(self.source, self.target).residual_covariance(T_target_source.inv())
        _, turn = self._turn(T_target_source.rotation)
        d = measured_rotation(self.target).apply(T_target_source.translation)
        # errors of the target's rotation turn the pose and, with a lever, the shift; the source's only the pose
        jacobian = np.zeros((len(d), 6, 3))
        jacobian[:, :3] = np.eye(3)
        jacobian[:, 3:] = -cross_matrices(self._lever(d, self.target))
        covariance = jacobian @ rotation_covariance(self.target) @ jacobian.transpose(0, 2, 1)
        covariance[:, :3, :3] += rotation_covariance(self.source, turn)
        known = self._known(self.target)
        covariance[:, 3:, 3:] += np.diag(np.where(known[3:], self._sigmas[3:], 0.0) ** 2)
        return covariance[:, known][:, :, known]

    def residual_jacobian(self, T_target_source: RigidTransform) -> np.ndarray:
        """How N relative poses' `residuals` change, (N, k, 6), to first order in what is left of their tilt.

        Of a turn w and a shift s in the target's axes, rotation first [rad, m]: R <- Exp(w) R, t <- t + s.
        """
        jacobian = np.zeros((len(T_target_source), 6, 6))
        if self._is_backward:
            R_world_target = (measured_rotation(self.source) * T_target_source.rotation.inv()).as_matrix()
            jacobian[:, :3, :3] = jacobian[:, 3:, 3:] = -R_world_target
            jacobian[:, 3:, :3] = -R_world_target @ cross_matrices(T_target_source.translation)
            return jacobian[:, self._known(self.source)]
        jacobian[:, :3, :3] = jacobian[:, 3:, 3:] = measured_rotation(self.target).as_matrix()
        return jacobian[:, self._known(self.target)]

    @property
    def _is_backward(self) -> bool:
        """Whether the source's prior knows better than the target's which way is up, and north."""
        return self._reference(Rotation.identity())[0] is not self.target

    @property
    def _sigmas(self) -> np.ndarray:
        """(6,) of the differences [rad, m]."""
        return np.hypot(self.target.sigmas, self.source.sigmas)

    @property
    def _shift(self) -> np.ndarray:
        """(3,) measured way from the target to the source [m, world]."""
        return self.source.T_world_sensor.translation - self.target.T_world_sensor.translation

    def _known(self, reference: PosePrior) -> np.ndarray:
        """(6,) bool: which of tilt, tilt, turn, East, North and Up are measured in full."""
        turned = self.knows_tilt and self.knows_heading
        leveled = self.knows_depth and reference.knows_attitude
        headed = self.knows_position and reference.knows_attitude and reference.knows_heading
        return np.array([self.knows_tilt, self.knows_tilt, turned, headed, headed, leveled])

    def _turn(self, R_target_source: Rotation) -> tuple[np.ndarray, np.ndarray]:
        """What is left of a rotation in the world, R_world_target R_target_source R_world_source^-1 = S Rz(turn).

        (N, 2) the rotation vectors of S, whose axes are level [rad], and (N,) turns within pi [rad].
        """
        R = Rotation.from_quat(np.atleast_2d(R_target_source.as_quat()))
        left = measured_rotation(self.target) * R * measured_rotation(self.source).inv()
        turn = twist(left)
        return (left * Rotation.from_euler("Z", turn[:, None]).inv()).as_rotvec()[:, :2], turn

    def _reference(self, R_target_source: Rotation) -> tuple[PosePrior, Rotation]:
        """The prior that knows better which way is up, and north; and R_world_target by it."""

        def worth(prior: PosePrior) -> tuple[bool, bool]:
            return prior.knows_attitude, prior.knows_attitude and prior.knows_heading

        if worth(self.source) > worth(self.target):
            return self.source, measured_rotation(self.source) * R_target_source.inv()
        return self.target, measured_rotation(self.target)

    def _lever(self, d: np.ndarray, reference: PosePrior) -> np.ndarray:
        """(..., 3) [m] what an error of the reference's rotation acts on: halfway from the measured shift to d.

        There a turn of any size moves the one to the other at right angles; d itself where nothing is measured.
        """
        headed = self.knows_position and reference.knows_heading
        return np.where([headed, headed, self.knows_depth], (d + self._shift) / 2, d)
