"""What one scan's prior says of its rotation: the measured one, its turn about the vertical, the errors of both."""

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.spectral.scan import PosePrior


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


def level_covariance(prior: PosePrior, turn: float | np.ndarray = 0.0) -> np.ndarray:
    """(2, 2), or (N, 2, 2) for N turns: of the errors of roll and pitch in the world [rad^2], turned about z."""
    angle = (np.asarray(turn) + twist(prior.T_world_sensor.rotation)) * prior.turned
    axes = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), (0, 1), (-2, -1))
    return axes * prior.sigmas[:2] ** 2 @ np.swapaxes(axes, -1, -2)


def rotation_covariance(prior: PosePrior, turn: float | np.ndarray = 0.0) -> np.ndarray:
    """(3, 3), or (N, 3, 3) for N turns: of all errors of rotation in the world [rad^2], 0 for what is not measured."""
    covariance = np.zeros((*np.shape(turn), 3, 3))
    if prior.knows_attitude:
        covariance[..., :2, :2] = level_covariance(prior, turn)
    covariance[..., 2, 2] = prior.sigmas[2] ** 2 if prior.knows_heading else 0.0
    return covariance
