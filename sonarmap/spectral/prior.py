"""The priors of two scans as a constraint on their relative pose: residuals, covariances and bounds."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.geometry import cross_matrices, level_covariance, measured_rotation, rotation_covariance
from sonarmap.spectral.scan import PosePrior

# Bound on rotations and shifts [standard deviations]
_ALLOWED_SIGMAS = 4.0
# Largest roll and pitch of a scan whose attitude is not measured [rad], the paper's range (Sect. 2.7)
UNMEASURED_TILT = np.deg2rad(35.0)
# Largest difference between yaw, in Rz(yaw) Ry(pitch) Rx(roll), and the turn about the vertical of one scan [rad]
_ONE_UNMEASURED = 2 * np.arctan(np.tan(UNMEASURED_TILT / 2) ** 2)
# and of two such scans [rad]: two tilts in a row also turn about the vertical
_TILT = np.arccos(np.cos(UNMEASURED_TILT) ** 2)
_TWO_UNMEASURED = 2 * _ONE_UNMEASURED + 2 * np.arcsin(np.tan(_TILT / 2) ** 2)


@dataclass(frozen=True, slots=True)
class Residuals:
    """Differences of N relative poses from the measurement, in the world's axes: k measured components, at most 6, of
    tilt, tilt, turn, East, North and Up [rad, m]."""

    residual: np.ndarray  # (N, k)
    # (N, k, 6) by a turn w and a shift s in the target's axes, rotation first [rad, m]: R <- Exp(w) R, t <- t + s
    jacobian: np.ndarray
    covariance: np.ndarray  # (N, k, k) of the residual, each pose taken for the true one


@dataclass(frozen=True)
class RelativePrior:
    """The priors of a pair, in one world; made by `relative_prior`.

    Both attitudes determine the relative rotation up to a turn about the world's vertical, `R_target_source =
    R_world_target^-1 Rz(any) R_world_source`; with both headings it is known in full. Headings without both attitudes
    bound the yaw alone, widened by the effect of roll and pitch up to `UNMEASURED_TILT`. The shift is bounded in the
    world's axes, whose directions in the target's frame follow from the target's prior, or, if the source's measures
    more, from that and R_target_source. Without any attitude only the length of the shift is bounded.

    Attributes:
        target, source: the priors of both scans.
    """

    target: PosePrior
    source: PosePrior

    @cached_property
    def knows_tilt(self) -> bool:
        """Whether the relative rotation is measured up to a turn about the vertical."""
        return self.target.knows_attitude and self.source.knows_attitude

    @cached_property
    def knows_heading(self) -> bool:
        """Whether the turn about the vertical is bounded: more widely without `knows_tilt`."""
        return self.target.knows_heading and self.source.knows_heading

    @cached_property
    def knows_position(self) -> bool:
        """Whether the horizontal shift is measured."""
        return self.target.knows_position and self.source.knows_position

    @cached_property
    def knows_depth(self) -> bool:
        """Whether the vertical shift is measured."""
        return self.target.knows_depth and self.source.knows_depth

    @property
    def R_target_source(self) -> Rotation | None:
        """The measured relative rotation; None unless attitude and heading are measured for both scans."""
        return self._R_world_target.inv() * self._R_world_source if self.knows_tilt and self.knows_heading else None

    @property
    def measures(self) -> bool:
        """Whether `at` has any component."""
        return bool(self._known.any())

    @property
    def is_complete(self) -> bool:
        """Whether all six components are measured."""
        return bool(self._known.all())

    def normalized(self, T_target_source: RigidTransform) -> tuple[float, int]:
        """Chi-squared of a relative pose, and its degrees of freedom; (0.0, 0) without any."""
        off = self.at(T_target_source.rotation, T_target_source.translation)
        return float(off.residual[0] @ np.linalg.solve(off.covariance[0], off.residual[0])), off.residual.shape[1]

    def at(self, R_target_source: Rotation, t: np.ndarray) -> Residuals:
        """Residuals of N relative poses, t (N, 3) or one for all [m], or of a single pose.

        Tilt (2 components) and turn (1) need both attitudes, height (1) needs an attitude, and the horizontal shift (2)
        also a heading. Measurements that only bound the pose have no residual. The covariance includes the correlation
        of rotation and shift by the error of the target's attitude.
        """
        R = Rotation.from_quat(np.atleast_2d(R_target_source.as_quat()))
        t = t + np.zeros((len(R), 1))
        jacobian = np.zeros((len(t), 6, 6))
        if self._is_backward:
            inverse = R.inv()
            off = self._swapped.at(inverse, -inverse.apply(t))
            R_world_target = (self._R_world_source * inverse).as_matrix()
            jacobian[:, :3, :3] = jacobian[:, 3:, 3:] = -R_world_target
            jacobian[:, 3:, :3] = -R_world_target @ cross_matrices(t)
            return replace(off, jacobian=jacobian[:, self._known])
        jacobian[:, :3, :3] = jacobian[:, 3:, 3:] = self._R_world_target.as_matrix()
        tilt, turn = self._turn(R)
        d = self._R_world_target.apply(t)
        # errors of the target's rotation turn the pose and, with a lever, the shift; the source's only the pose
        moved = np.zeros((len(d), 6, 3))
        moved[:, :3] = np.eye(3)
        moved[:, 3:] = -cross_matrices(self._lever(d, self.target))
        covariance = moved @ rotation_covariance(self.target) @ moved.transpose(0, 2, 1)
        covariance[:, :3, :3] += rotation_covariance(self.source, turn)
        covariance[:, 3:, 3:] += np.diag(np.where(self._known[3:], self._sigmas[3:], 0.0) ** 2)
        residual = np.column_stack([tilt, turn, d - self._shift])[:, self._known]
        return Residuals(residual, jacobian[:, self._known], covariance[:, self._known][:, :, self._known])

    @cached_property
    def _R_world_target(self) -> Rotation:
        return measured_rotation(self.target)

    @cached_property
    def _R_world_source(self) -> Rotation:
        return measured_rotation(self.source)

    @cached_property
    def _is_backward(self) -> bool:
        """Whether the source's prior measures more of its orientation than the target's."""
        target, source = ((each.knows_attitude, each.knows_heading) for each in (self.target, self.source))
        return source[0] and source > target

    @cached_property
    def _swapped(self) -> "RelativePrior":
        return RelativePrior(self.source, self.target)

    @cached_property
    def _sigmas(self) -> np.ndarray:
        """(6,) standard deviations of the differences between both priors [rad, m]."""
        return np.hypot(self.target.sigmas, self.source.sigmas)

    @cached_property
    def _shift(self) -> np.ndarray:
        """(3,) measured shift from the target to the source [m, world]."""
        return self.source.T_world_sensor.translation - self.target.T_world_sensor.translation

    @cached_property
    def _known(self) -> np.ndarray:
        """(6,) bool, which of tilt, tilt, turn, East, North and Up have a residual."""
        reference = self.source if self._is_backward else self.target
        turned = self.knows_tilt and self.knows_heading
        leveled = self.knows_depth and reference.knows_attitude
        headed = self.knows_position and reference.knows_attitude and reference.knows_heading
        return np.array([self.knows_tilt, self.knows_tilt, turned, headed, headed, leveled])

    def _turn(self, R_target_source: Rotation) -> tuple[np.ndarray, np.ndarray]:
        """Difference of N rotations from the measured one, R_world_target R R_world_source^-1 = S Rz(turn): (N, 2)
        rotation vectors of S, whose axes are level, and (N,) turns within pi [rad]."""
        difference = self._R_world_target * R_target_source * self._R_world_source.inv()
        x, y, z, w = difference.as_quat(canonical=True).T
        half = np.arctan2(z, w)
        # the quaternion of S has the real part hypot(z, w) and the imaginary part (x, y) turned by half of the turn
        level = np.column_stack([np.cos(half) * x - np.sin(half) * y, np.cos(half) * y + np.sin(half) * x])
        sine = np.linalg.norm(level, axis=1, keepdims=True)
        angle = 2 * np.arctan2(sine, np.hypot(z, w)[:, None])
        return level * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0), 2 * half

    def _lever(self, d: np.ndarray, reference: PosePrior) -> np.ndarray:
        """(..., 3) [m] lever of an error of the reference's rotation: the middle of the measured shift and d,
        perpendicular to their difference if a turn made it; d itself for components that are not measured."""
        headed = self.knows_position and reference.knows_heading
        return np.where([headed, headed, self.knows_depth], (d + self._shift) / 2, d)

    @property
    def tilt_sigma(self) -> float:
        """Standard deviation of the relative tilt about its least certain axis [rad]; inf if not measured."""
        return float(self._sigmas[:2].max())

    @property
    def turn_reach(self) -> float:
        """Largest difference of the turn about the vertical from the measured one [rad]; pi if not measured."""
        return min(float(_ALLOWED_SIGMAS * self._sigmas[2]), np.pi) if self.knows_heading else np.pi

    @property
    def shift_reach(self) -> np.ndarray:
        """(3,) largest difference from the measured shift along East, North and Up [m]; inf if not measured."""
        known = np.array([self.knows_position and self.knows_heading] * 2 + [self.knows_depth])
        return np.where(known, _ALLOWED_SIGMAS * self._sigmas[3:], np.inf)

    def turned(self, turns: np.ndarray, tilts: np.ndarray) -> Rotation:
        """The measured R_target_source with (n,) turns about the vertical [rad] and (m, 2) tilts, rotation vectors
        about East and North [rad]: n m rotations, turn by turn. Needs `knows_tilt`."""
        tilted = self._R_world_target.inv() * Rotation.from_rotvec(np.column_stack([tilts, np.zeros(len(tilts))]))
        about = Rotation.from_euler("Z", turns[:, None]) * self._R_world_source
        x, y, z, w = tilted.as_quat().T
        # products of quaternions: Rotation's take 20 times as long
        left = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
        return Rotation.from_quat(np.einsum("ijm,nj->nmi", left, about.as_quat()).reshape(-1, 4))

    def shift_box(self, R_target_source: Rotation) -> tuple[np.ndarray, np.ndarray] | None:
        """Center (3,) and half widths (..., 3) [m] of the box of 4 standard deviations that holds the source's origin,
        in the target's axes, under each rotation; None unless all three directions are measured."""
        if self._is_backward or not self._known[3:].all():
            return None
        t = self._R_world_target.inv().apply(self._shift)
        covariance = self.at(R_target_source, t).covariance[:, -3:, -3:]
        turn = self._R_world_target.as_matrix()
        half = _ALLOWED_SIGMAS * np.sqrt(np.diagonal(turn.T @ covariance @ turn, axis1=1, axis2=2))
        return t, half[0] if R_target_source.single else half

    def allows(self, R_target_source: Rotation, slack: float = 0.0) -> np.ndarray:
        """Whether a rotation, or each of a stack, agrees with attitudes and headings within 4 standard deviations and a
        slack [rad]; tilt and turn about the vertical are tested separately."""
        tilt, turn = self._turn(Rotation.from_quat(np.atleast_2d(R_target_source.as_quat())))
        allowed = np.ones(len(turn), dtype=bool)
        if self.knows_tilt:
            covariance = level_covariance(self.target) + level_covariance(self.source, turn)
            allowed &= _within(tilt, covariance, slack)
        if self.knows_heading:
            unmeasured = 2 - self.target.knows_attitude - self.source.knows_attitude
            widened = slack + (0.0, _ONE_UNMEASURED, _TWO_UNMEASURED)[unmeasured]
            allowed &= np.abs(turn) <= _ALLOWED_SIGMAS * self._sigmas[2] + widened
        return allowed.reshape(()) if R_target_source.single else allowed

    def allows_shift(self, t: np.ndarray, R_target_source: Rotation, slack: float = 0.0) -> np.ndarray:
        """Whether translations (3,) or (N, 3) [m], T_target_source.translation, agree with depths and positions within
        4 standard deviations and a slack [m]; height and horizontal shift are tested separately.

        The error of the attitude and heading that turn the shift into the world is included: it grows with the shift.
        R_target_source, one or a stack of N, is used if the source's prior measures more of its orientation than the
        target's.
        """
        reference, R_world_target = self.target, self._R_world_target
        if self._is_backward:
            reference, R_world_target = self.source, self._R_world_source * R_target_source.inv()
        d = np.atleast_2d(R_world_target.apply(t))
        if not R_target_source.single:
            d = np.broadcast_to(d, (len(R_target_source), 3))
        if reference.knows_attitude:
            allowed = self._allows_height(d, reference, slack) & self._allows_horizontal(d, reference, slack)
        else:
            allowed = self._allows_length(np.linalg.norm(d, axis=1), slack)
        return allowed.reshape(()) if np.ndim(t) == 1 and R_target_source.single else allowed

    def _allows_height(self, d: np.ndarray, reference: PosePrior, slack: float) -> np.ndarray:
        if not self.knows_depth:
            return np.ones(len(d), dtype=bool)
        lever = self._lever(d, reference)[:, :2] @ np.array([[0.0, -1.0], [1.0, 0.0]])
        by_tilt = np.einsum("ni,ij,nj->n", lever, level_covariance(reference), lever)
        return np.abs(d[:, 2] - self._shift[2]) <= _ALLOWED_SIGMAS * np.sqrt(self._sigmas[5] ** 2 + by_tilt) + slack

    def _allows_horizontal(self, d: np.ndarray, reference: PosePrior, slack: float) -> np.ndarray:
        """Test both axes if the heading is measured, else the distance alone."""
        if not self.knows_position:
            return np.ones(len(d), dtype=bool)
        quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])
        lever = self._lever(d, reference)
        by_tilt = lever[:, 2, None, None] ** 2 * (quarter @ level_covariance(reference) @ quarter.T)
        if not reference.knows_heading:
            variance = self._sigmas[3:5].max() ** 2 + np.linalg.eigvalsh(by_tilt)[:, -1]
            off = np.abs(np.linalg.norm(d[:, :2], axis=1) - np.linalg.norm(self._shift[:2]))
            return off <= _ALLOWED_SIGMAS * np.sqrt(variance) + slack
        aside = lever[:, :2] @ quarter
        by_heading = reference.sigmas[2] ** 2 * aside[:, :, None] * aside[:, None, :]
        covariance = np.diag(self._sigmas[3:5] ** 2) + by_tilt + by_heading
        return _within(d[:, :2] - self._shift[:2], covariance, slack)

    def _allows_length(self, length: np.ndarray, slack: float) -> np.ndarray:
        """Test lengths (N,) [m] against the measured shift; if it is measured in part, only from below."""
        known = np.isfinite(self._sigmas[3:])
        if not known.any():
            return np.ones(len(length), dtype=bool)
        off = length - np.linalg.norm(self._shift[known])
        margin = _ALLOWED_SIGMAS * self._sigmas[3:][known].max() + slack
        return np.abs(off) <= margin if known.all() else off >= -margin


def relative_prior(target: PosePrior | None, source: PosePrior | None) -> RelativePrior | None:
    """Constraint of two scans' priors on T_target_source; None if they do not bound it.

    Args:
        target, source: the scans' `prior`, or None.
    """
    if target is None or source is None:
        return None
    prior = RelativePrior(target, source)
    known = prior.knows_tilt or prior.knows_heading or prior.knows_position or prior.knows_depth
    return prior if known else None


def _within(offsets: np.ndarray, covariance: np.ndarray, slack: float) -> np.ndarray:
    """(N,) bool, which of (N, 2) offsets, shortened by the slack, lie in the ellipse of 4 standard deviations."""
    length = np.linalg.norm(offsets, axis=1, keepdims=True)
    offsets = offsets * (np.maximum(length - slack, 0.0) / np.where(length > 0, length, 1.0))
    (a, b), (_, c) = np.moveaxis(np.broadcast_to(covariance, (len(offsets), 2, 2)), 0, -1)
    x, y = offsets.T
    return c * x**2 - 2 * b * x * y + a * y**2 <= _ALLOWED_SIGMAS**2 * (a * c - b**2)
