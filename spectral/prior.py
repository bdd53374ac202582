# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""What the priors of two scans say about their relative pose: which rotations and shifts they allow."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from spectral.scan import PosePrior

# Standard deviations within which a rotation or a shift is allowed.
_ALLOWED_SIGMAS = 4.0
# Largest roll and pitch of a scan whose attitude is not measured [rad], the paper's range (Sect. 2.7)
UNMEASURED_TILT = np.deg2rad(35.0)
# What roll and pitch can add to the turn of one scan about the vertical [rad], beyond yaw in Rz(yaw) Ry(pitch) Rx(roll)
_ONE_UNMEASURED = 2 * np.arctan(np.tan(UNMEASURED_TILT / 2) ** 2)
# and to the turn between two such scans: two tilts after each other turn about the vertical besides
_TILT = np.arccos(np.cos(UNMEASURED_TILT) ** 2)
_TWO_UNMEASURED = 2 * _ONE_UNMEASURED + 2 * np.arcsin(np.tan(_TILT / 2) ** 2)


@dataclass(frozen=True, slots=True)
class RelativePrior:
    """The priors of a pair; made by `relative_prior`.

    With both attitudes the relative rotation is known but for a turn about the world's vertical,
    `R_target_source = R_world_target^-1 Rz(any) R_world_source`, with both headings wholly. A heading without an
    attitude bounds the yaw alone, and as widely as roll and pitch up to `UNMEASURED_TILT` require. The shift is bounded
    in the world's axes. Which way these point in the target's frame is known from the target's prior, or, where the
    source's knows more, from that and R_target_source. Without any attitude only the length of the shift is bounded.

    Attributes:
        target, source: of the two scans, in one world.
    """

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

    def allows(self, R_target_source: Rotation, slack: float = 0.0) -> np.ndarray:
        """Whether a rotation agrees with attitudes and headings within 4 standard deviations and a slack.

        Args:
            R_target_source: one rotation, or a stack of N.
            slack: what the rotation may be off by besides [rad]: of the tilt, and again of the turn about the vertical.

        Returns:
            bool of shape () for one rotation, (N,) for a stack.
        """
        tilt, turn = self._turn(R_target_source)
        allowed = np.ones(len(turn), dtype=bool)
        if self.knows_tilt:
            covariance = _level_covariance(self.target) + _level_covariance(self.source, turn)
            allowed &= _within(tilt, covariance, slack)
        if self.knows_heading:
            unmeasured = 2 - self.target.knows_attitude - self.source.knows_attitude
            widened = slack + (0.0, _ONE_UNMEASURED, _TWO_UNMEASURED)[unmeasured]
            allowed &= np.abs(turn) <= _ALLOWED_SIGMAS * self._sigmas[2] + widened
        return allowed.reshape(()) if R_target_source.single else allowed

    def allows_shift(self, t: np.ndarray, R_target_source: Rotation, slack: float = 0.0) -> np.ndarray:
        """Whether a translation agrees with depths and positions within 4 standard deviations and a slack.

        The error of the attitude and heading that turn the shift into the world counts too: it grows with the shift.

        Args:
            t: (3,) or (N, 3) [m], T_target_source.translation: the source's origin in the target's frame.
            R_target_source: one rotation, or a stack of N; used only where the source knows better than the target
                which way is up, or north.
            slack: what the translation may be off by besides [m]: in height, and again horizontally.

        Returns:
            bool of shape () for one translation and rotation, else (N,).
        """
        reference, R_world_target = self._reference(R_target_source)
        d = np.atleast_2d(R_world_target.apply(t))
        if not R_target_source.single:
            d = np.broadcast_to(d, (len(R_target_source), 3))
        if reference.knows_attitude:
            allowed = self._allows_height(d, reference, slack) & self._allows_horizontal(d, reference, slack)
        else:
            allowed = self._allows_length(np.linalg.norm(d, axis=1), slack)
        return allowed.reshape(()) if np.ndim(t) == 1 and R_target_source.single else allowed

    def normalized(self, T_target_source: RigidTransform) -> tuple[float, int]:
        """How far a relative pose is from what was measured: chi-squared, and its degrees of freedom.

        Counted are the tilt (2) and the turn (1) where both attitudes are known, the height (1) where an attitude is
        known, and the horizontal shift (2) where a heading is known with it. An error of the attitude that turns
        the scan and its shift alike is counted once. What only bounds is not counted: (0.0, 0) where nothing else
        is known.
        """
        reference, R_world_target = self._reference(T_target_source.rotation)
        if reference is not self.target:
            return RelativePrior(self.source, self.target).normalized(T_target_source.inv())
        tilt, turn = self._turn(T_target_source.rotation)
        d = R_world_target.apply(T_target_source.translation)
        residual = np.concatenate([tilt[0], turn, d - self._shift])
        # errors of the target's rotation turn the pose and, with a lever, the shift; the source's only the pose
        x, y, z = self._lever(d, reference)
        jacobian = np.vstack([np.eye(3), [[0, z, -y], [-z, 0, x], [y, -x, 0]]])
        covariance = jacobian @ _rotation_covariance(self.target) @ jacobian.T
        covariance[:3, :3] += _rotation_covariance(self.source, turn[0])
        known = self._known(reference)
        covariance[3:, 3:] += np.diag(np.where(known[3:], self._sigmas[3:], 0.0) ** 2)
        residual, covariance = residual[known], covariance[np.ix_(known, known)]
        return float(residual @ np.linalg.solve(covariance, residual)), int(known.sum())

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

        Returns:
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

    def _allows_height(self, d: np.ndarray, reference: PosePrior, slack: float) -> np.ndarray:
        if not self.knows_depth:
            return np.ones(len(d), dtype=bool)
        lever = self._lever(d, reference)[:, :2] @ np.array([[0.0, -1.0], [1.0, 0.0]])
        by_tilt = np.einsum("ni,ij,nj->n", lever, _level_covariance(reference), lever)
        return np.abs(d[:, 2] - self._shift[2]) <= _ALLOWED_SIGMAS * np.sqrt(self._sigmas[5] ** 2 + by_tilt) + slack

    def _allows_horizontal(self, d: np.ndarray, reference: PosePrior, slack: float) -> np.ndarray:
        """In both axes where the heading is known, else by the distance alone."""
        if not self.knows_position:
            return np.ones(len(d), dtype=bool)
        quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])
        lever = self._lever(d, reference)
        by_tilt = lever[:, 2, None, None] ** 2 * (quarter @ _level_covariance(reference) @ quarter.T)
        if not reference.knows_heading:
            variance = self._sigmas[3:5].max() ** 2 + np.linalg.eigvalsh(by_tilt)[:, -1]
            off = np.abs(np.linalg.norm(d[:, :2], axis=1) - np.linalg.norm(self._shift[:2]))
            return off <= _ALLOWED_SIGMAS * np.sqrt(variance) + slack
        aside = lever[:, :2] @ quarter
        by_heading = reference.sigmas[2] ** 2 * aside[:, :, None] * aside[:, None, :]
        covariance = np.diag(self._sigmas[3:5] ** 2) + by_tilt + by_heading
        return _within(d[:, :2] - self._shift[:2], covariance, slack)

    def _allows_length(self, length: np.ndarray, slack: float) -> np.ndarray:
        """Lengths (N,) [m] by all of the measured shift, or at least as long as the part of it that is measured."""
        known = np.isfinite(self._sigmas[3:])
        if not known.any():
            return np.ones(len(length), dtype=bool)
        off = length - np.linalg.norm(self._shift[known])
        margin = _ALLOWED_SIGMAS * self._sigmas[3:][known].max() + slack
        return np.abs(off) <= margin if known.all() else off >= -margin


def relative_prior(target: PosePrior | None, source: PosePrior | None) -> RelativePrior | None:
    """What two scans' priors say about T_target_source.

    Args:
        target, source: the scans' `prior`, None where they have none.

    Returns:
        None where the priors bound nothing.
    """
    if target is None or source is None:
        return None
    prior = RelativePrior(target, source)
    known = prior.knows_tilt or prior.knows_heading or prior.knows_position or prior.knows_depth
    return prior if known else None


def measured_rotation(prior: PosePrior) -> Rotation:
    """R_world_sensor, level where the attitude is not measured."""
    R = prior.T_world_sensor.rotation
    return R if prior.knows_attitude else Rotation.from_euler("Z", twist(R))


def twist(R: Rotation) -> np.ndarray:
    """(...) the turn about the vertical of R = S Rz(turn), S about a level axis [rad], within pi.

    The same as that of R = Rz(turn) S'. Undefined upside down, where it is 0.
    """
    quaternion = R.as_quat(canonical=True)
    return 2 * np.arctan2(quaternion[..., 2], quaternion[..., 3])


def _level_covariance(prior: PosePrior, turn: float | np.ndarray = 0.0) -> np.ndarray:
    """(2, 2), or (N, 2, 2) for N turns: of the errors of roll and pitch in the world [rad^2], turned about z."""
    angle = np.asarray(turn) + twist(prior.T_world_sensor.rotation)
    axes = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), (0, 1), (-2, -1))
    return axes * prior.sigmas[:2] ** 2 @ np.swapaxes(axes, -1, -2)


def _rotation_covariance(prior: PosePrior, turn: float = 0.0) -> np.ndarray:
    """(3, 3) of all errors of rotation in the world [rad^2], 0 for what is not measured."""
    covariance = np.zeros((3, 3))
    if prior.knows_attitude:
        covariance[:2, :2] = _level_covariance(prior, turn)
    covariance[2, 2] = prior.sigmas[2] ** 2 if prior.knows_heading else 0.0
    return covariance


def _within(offsets: np.ndarray, covariance: np.ndarray, slack: float) -> np.ndarray:
    """(N,) bool: which of (N, 2) offsets, shortened by the slack, lie in the ellipse of 4 standard deviations."""
    length = np.linalg.norm(offsets, axis=1, keepdims=True)
    offsets = offsets * np.maximum(0.0, 1.0 - slack / np.maximum(length, np.finfo(float).tiny))
    (a, b), (_, c) = np.moveaxis(np.broadcast_to(covariance, (len(offsets), 2, 2)), 0, -1)
    x, y = offsets.T
    return c * x**2 - 2 * b * x * y + a * y**2 <= _ALLOWED_SIGMAS**2 * (a * c - b**2)
