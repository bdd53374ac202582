"""Where one scan is expected relative to another, by the vehicle's motion, as a bound on their registration."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.geometry import measured_rotation, twist
from sonarmap.spectral.scan import PosePrior

# Of what a world that is made for one pair knows by definition [rad, m].
_EXACT = 1e-4
_DIGITS = 6
_UNMEASURED = 1e9  # [rad, m], in place of infinite sigmas


@dataclass(frozen=True, slots=True)
class ExpectedPose:
    """T_target_source as it is expected before the scans are compared."""

    rotation: np.ndarray  # (3,) rotation vector [rad]
    translation: np.ndarray  # (3,) [m], in the target's axes
    sigmas: np.ndarray  # (6,) standard deviations about and along the target's axes, rotation first [rad, m]

    def __post_init__(self) -> None:
        shapes = [(self.rotation, (3,)), (self.translation, (3,)), (self.sigmas, (6,))]
        if any(array.shape != shape or not np.isfinite(array).all() for array, shape in shapes):
            raise InputError("an expected pose has 3 finite numbers of rotation, 3 of translation and 6 sigmas")
        if not (self.sigmas > 0).all():
            raise InputError(f"`sigmas` are {self.sigmas.tolist()}; wanted numbers above 0")

    @property
    def T_target_source(self) -> RigidTransform:
        return RigidTransform.from_components(self.translation, Rotation.from_rotvec(self.rotation))

    @classmethod
    def of(cls, T_target_source: RigidTransform, sigmas: np.ndarray) -> "ExpectedPose":
        """Rounded, so that what a journal holds is found again though a last bit has changed."""
        turn, shift = (
            np.round(x, _DIGITS) for x in (T_target_source.rotation.as_rotvec(), T_target_source.translation)
        )
        return cls(turn, shift, np.maximum(np.round(sigmas, _DIGITS), _EXACT))

    def priors(self, target: PosePrior | None, source: PosePrior | None) -> tuple[PosePrior, PosePrior]:
        """Priors of both scans that say what is expected, and what instruments measured where that is surer.

        Their world is one of the pair's own: the target's sensor is at its origin and heads for its x axis. Where both
        attitudes are measured it is level, else its axes are the target's. Given is what instruments measured of the
        scans, None where nothing.
        """
        if target is not None and source is not None and target.knows_attitude and source.knows_attitude:
            return self._leveled(target, source)
        T = RigidTransform.identity()
        return PosePrior(T, np.full(6, _EXACT)), PosePrior(self.T_target_source, self.sigmas.copy(), turned=False)

    def _leveled(self, target: PosePrior, source: PosePrior) -> tuple[PosePrior, PosePrior]:
        ahead = Rotation.from_euler("Z", -twist(target.T_world_sensor.rotation))
        R_target, R_source = (ahead * measured_rotation(each) for each in (target, source))
        # variances about and along the world's axes
        R: np.ndarray = R_target.as_matrix() ** 2
        expected = np.sqrt(np.concatenate([R @ self.sigmas[:3] ** 2, R @ self.sigmas[3:] ** 2]))[2:]
        shift = R_target.apply(self.translation)
        measured = ahead.apply(source.T_world_sensor.translation - target.T_world_sensor.translation)
        both = np.minimum(np.hypot(target.sigmas, source.sigmas), _UNMEASURED)
        turned: np.ndarray = ahead.as_matrix() ** 2
        sigmas = np.array([both[2], *np.sqrt(turned @ both[3:] ** 2)])
        headed = sigmas[0] < expected[0]
        if not headed:
            expected_turn = twist(R_target * Rotation.from_rotvec(self.rotation))
            R_source = Rotation.from_euler("Z", expected_turn - twist(R_source)) * R_source
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
