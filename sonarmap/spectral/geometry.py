"""Measured rotations of scans and their covariances, the bound on tilt, and covariances at the sensor."""

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.spectral.scan import PosePrior


def measured_rotation(prior: PosePrior) -> Rotation:
    """R_world_sensor; without a measured attitude only its turn about the vertical."""
    R = prior.R_world_sensor
    return R if prior.knows_attitude else Rotation.from_euler("Z", twist(R))


def twist(R: Rotation) -> np.ndarray:
    """(...) turn about the vertical [rad], within pi, of R = S Rz(turn) with S about a level axis.

    R = Rz(turn) S' has the same turn. It is undefined upside down; 0 is returned there.
    """
    quaternion = R.as_quat(canonical=True)
    return 2 * np.arctan2(quaternion[..., 2], quaternion[..., 3])


def level_covariance(prior: PosePrior, turn: float | np.ndarray = 0.0) -> np.ndarray:
    """Covariance (2, 2), or (N, 2, 2) for N turns, of roll and pitch errors in the world [rad^2], turned about z."""
    angle = (np.asarray(turn) + twist(prior.R_world_sensor)) * prior.turned
    inverse = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).T
    return inverse.mT * prior.sigmas[:2] ** 2 @ inverse


def rotation_covariance(prior: PosePrior, turn: float | np.ndarray = 0.0) -> np.ndarray:
    """Covariance (3, 3), or (N, 3, 3) for N turns, of the rotation's errors in the world [rad^2]; 0 if not measured."""
    covariance = np.zeros((*np.shape(turn), 3, 3))
    if prior.knows_attitude:
        covariance[..., :2, :2] = level_covariance(prior, turn)
    covariance[..., 2, 2] = prior.sigmas[2] ** 2 if prior.knows_heading else 0.0
    return covariance


def rotated(R: Rotation, covariance: np.ndarray) -> np.ndarray:
    """(..., 6, 6) covariances or information of turns and shifts along other axes, x = R x'; of (...) rotations."""
    turn = np.zeros((*np.shape(R.as_quat())[:-1], 6, 6))
    turn[..., :3, :3] = turn[..., 3:, 3:] = R.as_matrix()
    return turn @ covariance @ np.swapaxes(turn, -1, -2)


def covariance_at_sensor(about_center: np.ndarray, center: np.ndarray) -> np.ndarray:
    """(6, 6), rotation first, body tangent of the source's sensor frame [rad, m]: by the adjoint of a translation, from
    errors (6, 6) about the source's grid center (3,) [m, source sensor frame], in its axes."""
    shift = np.eye(6)
    shift[3:, :3] = cross_matrices(center[None])[0]
    moved = shift @ about_center @ shift.T
    return (moved + moved.T) / 2


def cross_matrices(vectors: np.ndarray) -> np.ndarray:
    """(N, 3, 3) by which a vector is multiplied to get the cross product of each of (N, 3) with it."""
    x, y, z = vectors.T
    nothing = np.zeros_like(x)
    return np.moveaxis(np.array([[nothing, -z, y], [z, nothing, -x], [-y, x, nothing]]), 2, 0)


# Tolerance for the error of the estimated tilt [rad].
_TILT_SLACK = float(np.deg2rad(3.0))


def largest_tilt(R: Rotation) -> np.ndarray:
    """Larger of |roll| and |pitch| [rad], R = Rz(yaw) Ry(pitch) Rx(roll): () for one rotation, (n,) for a stack."""
    return np.abs(R.as_euler("ZYX")[..., 1:]).max(axis=-1)


def tilt_allowed(R_target_source: Rotation, max_tilt: float) -> np.ndarray:
    """Whether roll and pitch exceed the bound [rad] by at most 3 degrees, the tolerance of estimates; () or (n,)."""
    return largest_tilt(R_target_source) <= max_tilt + _TILT_SLACK


def tilt_reach(max_tilt: float) -> float:
    """Largest component of the rotation vector along a level axis of the target under that bound [rad]: roll and pitch,
    both at the bound, may add up to sqrt(2) times the bound about one axis."""
    return float(np.sqrt(2.0)) * (max_tilt + _TILT_SLACK)


def tilt_refusal(R_target_source: Rotation, max_tilt: float) -> str:
    """Reason to refuse a rotation beyond the bound [rad], in words; "" if it is allowed."""
    if tilt_allowed(R_target_source, max_tilt):
        return ""
    tilt = np.rad2deg(largest_tilt(R_target_source))
    return f"roll or pitch is {tilt:.0f} degrees; accepted up to {np.rad2deg(max_tilt):g} degrees"
