"""Where one scan is expected relative to another, by the vehicle's motion, as a bound on their registration."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.geometry import measured_rotation, rotated, twist
from sonarmap.spectral.scan import PosePrior

# Of what a world that is made for one pair knows by definition [rad, m].
_EXACT = 1e-4
_POSE_DIGITS, _COVARIANCE_DIGITS = 6, 12
_UNMEASURED = 1e9  # [rad, m], in place of infinite sigmas


@dataclass(frozen=True, slots=True)
class ExpectedPose:
    """T_target_source as it is expected before the scans are compared."""

    T_target_source: RigidTransform
    covariance: np.ndarray  # (6, 6), rotation first [rad, m], body tangent of the source, as a `Registration`'s
    # whether instruments measured the poses of both scans, so that the expectation is evidence for the place, too
    by_instruments: bool = False

    def __post_init__(self) -> None:
        if self.covariance.shape != (6, 6) or not np.isfinite(self.covariance).all():
            raise InputError(f"the covariance of an expected pose is {self.covariance}; wanted (6, 6) finite numbers")
        if not (np.linalg.eigvalsh(self.covariance) > 0).all():
            raise InputError("the covariance of an expected pose is not positive definite")

    @classmethod
    def of(
        cls, T_target_source: RigidTransform, covariance: np.ndarray, by_instruments: bool = False
    ) -> "ExpectedPose":
        """Rounded, so that what a journal holds is found again though a last bit has changed."""
        turn, shift = T_target_source.rotation.as_rotvec(), T_target_source.translation
        R = Rotation.from_rotvec(np.round(turn, _POSE_DIGITS))
        T = RigidTransform.from_components(np.round(shift, _POSE_DIGITS), R)
        return cls(T, np.round(covariance, _COVARIANCE_DIGITS) + _EXACT**2 * np.eye(6), by_instruments)

    @classmethod
    def along_target(cls, T_target_source: RigidTransform, sigmas: np.ndarray) -> "ExpectedPose":
        """With (6,) standard deviations of independent errors about and along the target's axes [rad, m]."""
        return cls.of(T_target_source, rotated(T_target_source.rotation.inv(), np.diag(sigmas**2)))

    @property
    def sigmas(self) -> np.ndarray:
        """(6,) standard deviations about and along the target's axes, rotation first [rad, m]."""
        return np.sqrt(np.diag(rotated(self.T_target_source.rotation, self.covariance)))

    def relative_to(self, T_target_source: RigidTransform) -> tuple[np.ndarray, np.ndarray]:
        """The step (6,) to it from another pose of the source, and its (6, 6) covariance, in the axes of that pose."""
        T_other_expected = T_target_source.inv() * self.T_target_source
        return np.asarray(T_other_expected.as_exp_coords()), rotated(T_other_expected.rotation, self.covariance)

    def distance(self, T_target_source: RigidTransform) -> float:
        """How far another pose is from it (Mahalanobis)."""
        xi: np.ndarray = (self.T_target_source.inv() * T_target_source).as_exp_coords()
        return float(np.sqrt(xi @ np.linalg.solve(self.covariance, xi)))

    def priors(self, target: PosePrior | None, source: PosePrior | None) -> tuple[PosePrior, PosePrior]:
        """Priors of both scans that say what is expected, and what instruments measured where that is surer.

        Their world is one of the pair's own: the target's sensor is at its origin and heads for its x axis. Where both
        attitudes are measured it is level, else its axes are the target's. Given is what instruments measured of the
        scans, None where nothing.
        """
        if target is not None and source is not None and target.knows_attitude and source.knows_attitude:
            return self._leveled(target, source)
        T = RigidTransform.identity()
        return PosePrior(T, np.full(6, _EXACT)), PosePrior(self.T_target_source, self.sigmas, turned=False)

    def _leveled(self, target: PosePrior, source: PosePrior) -> tuple[PosePrior, PosePrior]:
        ahead = Rotation.from_euler("Z", -twist(target.T_world_sensor.rotation))
        R_target, R_source = (ahead * measured_rotation(each) for each in (target, source))
        R_expected = R_target * self.T_target_source.rotation
        expected = np.sqrt(np.diag(rotated(R_expected, self.covariance)))[2:]  # turn, East, North, Up of this world
        shift = R_target.apply(self.T_target_source.translation)
        measured = ahead.apply(source.T_world_sensor.translation - target.T_world_sensor.translation)
        both = np.minimum(np.hypot(target.sigmas, source.sigmas), _UNMEASURED)
        turned: np.ndarray = ahead.as_matrix() ** 2
        sigmas = np.array([both[2], *np.sqrt(turned @ both[3:] ** 2)])
        headed = sigmas[0] < expected[0]
        if not headed:
            R_source = Rotation.from_euler("Z", twist(R_expected) - twist(R_source)) * R_source
        # a measured way to East and North is one in this world only where the heading is that of the true world
        surer = (sigmas < expected)[1:] & np.array([headed, headed, True])
        combined = np.where(surer, measured, shift)
        at_target = np.concatenate([target.sigmas[:2], np.full(4, _EXACT)])
        at_source = np.concatenate([source.sigmas[:2], np.minimum(sigmas[:1], expected[:1]), expected[1:]])
        at_source[3:][surer] = sigmas[1:][surer]
        return (
            PosePrior(RigidTransform.from_components(np.zeros(3), R_target), at_target),
            PosePrior(RigidTransform.from_components(combined, R_source), at_source),
        )
