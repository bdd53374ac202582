"""What the priors of two scans say about their relative pose: which rotations and shifts they allow."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.geometry import level_covariance, measured_rotation
from sonarmap.spectral.prior_pair import PriorPair
from sonarmap.spectral.scan import PosePrior

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
class RelativePrior(PriorPair):
    """The priors of a pair; made by `relative_prior`.

    With both attitudes the relative rotation is known but for a turn about the world's vertical,
    `R_target_source = R_world_target^-1 Rz(any) R_world_source`, with both headings wholly. A heading without an
    attitude bounds the yaw alone, and as widely as roll and pitch up to `UNMEASURED_TILT` require. The shift is bounded
    in the world's axes. Which way these point in the target's frame is known from the target's prior, or, where the
    source's knows more, from that and R_target_source. Without any attitude only the length of the shift is bounded.

    Attributes:
        target, source: of the two scans, in one world.
    """

    @property
    def tilt_sigma(self) -> float:
        """Standard deviation of the relative tilt about its least sure axis [rad]; inf where it is not known."""
        return float(self._sigmas[:2].max())

    @property
    def turn_reach(self) -> float:
        """How far the turn about the vertical may be from the measured one [rad]; pi where it is not known."""
        return min(float(_ALLOWED_SIGMAS * self._sigmas[2]), np.pi) if self.knows_heading else np.pi

    @property
    def shift_reach(self) -> np.ndarray:
        """(3,) how far the shift may be from the measured along East, North and Up [m]; inf where it is not known."""
        known = np.array([self.knows_position and self.knows_heading] * 2 + [self.knows_depth])
        return np.where(known, _ALLOWED_SIGMAS * self._sigmas[3:], np.inf)

    def turned(self, turns: np.ndarray, tilts: np.ndarray) -> Rotation:
        """The measured R_target_source, turned about the vertical and tilted about level axes; where `knows_tilt`.

        n m rotations, turn by turn, of turns (n,) [rad], from the measured one where the headings are known, and tilts
        (m, 2), rotation vectors about East and North [rad].
        """
        about = Rotation.from_euler("Z", np.repeat(turns, len(tilts))[:, None])
        tilted = Rotation.from_rotvec(np.tile(np.column_stack([tilts, np.zeros(len(tilts))]), (len(turns), 1)))
        return measured_rotation(self.target).inv() * tilted * about * measured_rotation(self.source)

    def shift_box(self, R_target_source: Rotation) -> tuple[np.ndarray, np.ndarray] | None:
        """Center (3,) and half widths (3,) [m] of where the source's origin may be in the target's axes.

        Within 4 standard deviations; None where not all three directions are measured.
        """
        if self._is_backward or not self._known(self.target)[3:].all():
            return None
        R_world_target = measured_rotation(self.target)
        t = R_world_target.inv().apply(self._shift)
        T = RigidTransform.concatenate([RigidTransform.from_components(t, R_target_source)])
        covariance = self.residual_covariance(T)[0, -3:, -3:]
        turn = R_world_target.as_matrix()
        return t, _ALLOWED_SIGMAS * np.sqrt(np.diag(turn.T @ covariance @ turn))

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
            covariance = level_covariance(self.target) + level_covariance(self.source, turn)
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

    def _allows_height(self, d: np.ndarray, reference: PosePrior, slack: float) -> np.ndarray:
        if not self.knows_depth:
            return np.ones(len(d), dtype=bool)
        lever = self._lever(d, reference)[:, :2] @ np.array([[0.0, -1.0], [1.0, 0.0]])
        by_tilt = np.einsum("ni,ij,nj->n", lever, level_covariance(reference), lever)
        return np.abs(d[:, 2] - self._shift[2]) <= _ALLOWED_SIGMAS * np.sqrt(self._sigmas[5] ** 2 + by_tilt) + slack

    def _allows_horizontal(self, d: np.ndarray, reference: PosePrior, slack: float) -> np.ndarray:
        """In both axes where the heading is known, else by the distance alone."""
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
        """Lengths (N,) [m] by all of the measured shift, or at least as long as the part of it that is measured."""
        known = np.isfinite(self._sigmas[3:])
        if not known.any():
            return np.ones(len(length), dtype=bool)
        off = length - np.linalg.norm(self._shift[known])
        margin = _ALLOWED_SIGMAS * self._sigmas[3:][known].max() + slack
        return np.abs(off) <= margin if known.all() else off >= -margin


def relative_prior(target: PosePrior | None, source: PosePrior | None) -> RelativePrior | None:
    """What two scans' priors say about T_target_source; None where they bound nothing.

    Args:
        target, source: the scans' `prior`, None where they have none.
    """
    if target is None or source is None:
        return None
    prior = RelativePrior(target, source)
    known = prior.knows_tilt or prior.knows_heading or prior.knows_position or prior.knows_depth
    return prior if known else None


def _within(offsets: np.ndarray, covariance: np.ndarray, slack: float) -> np.ndarray:
    """(N,) bool: which of (N, 2) offsets, shortened by the slack, lie in the ellipse of 4 standard deviations."""
    length = np.linalg.norm(offsets, axis=1, keepdims=True)
    offsets = offsets * (np.maximum(length - slack, 0.0) / np.where(length > 0, length, 1.0))
    (a, b), (_, c) = np.moveaxis(np.broadcast_to(covariance, (len(offsets), 2, 2)), 0, -1)
    x, y = offsets.T
    return c * x**2 - 2 * b * x * y + a * y**2 <= _ALLOWED_SIGMAS**2 * (a * c - b**2)
