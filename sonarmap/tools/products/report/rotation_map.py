"""The correlation over all rotations as a surveyor reads it: over yaw, and over the angle between the two verticals."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.spectral.tilt import tilt_allowed


@dataclass(frozen=True, slots=True)
class RotationMap:
    """For each yaw and tilt the highest value of the correlation over SO(3).

    Attributes:
        values: (tilts, yaws) float64, a share of what two equal scans would have; NaN where no rotation is allowed.
        tilts: (tilts + 1,) edges of the rows [deg]: the angle between the z axes of target and source.
        yaws: (yaws + 1,) edges of the columns [deg], from -180 to 180; R = Rz(yaw) Ry(pitch) Rx(roll).
    """

    values: np.ndarray
    tilts: np.ndarray
    yaws: np.ndarray


def map_rotations(correlation: np.ndarray, bandwidth: int, max_tilt: float) -> RotationMap:
    """The map of a correlation from `RotationCorrelation.correlate`, whose last image is no part of it.

    Args:
        correlation: (n + 1, edge, edge): [b, i, j] is of the rotation Rz(alpha) Ry(beta) Rz(gamma), alpha and gamma
            around the full circle, beta evenly from half a step on.
        bandwidth: of the correlation; pi / (2 bandwidth) is a step of beta.
        max_tilt: largest roll and largest pitch that are allowed [rad].
    """
    count, edge = len(correlation) - 1, correlation.shape[1]
    step, turn = np.pi / (2 * bandwidth), 2 * np.pi / edge
    alpha, gamma = (angle.ravel() * turn for angle in np.meshgrid(*[np.arange(edge)] * 2, indexing="ij"))
    values = np.full((count, edge), -np.inf)
    for row, beta in enumerate((np.arange(count) + 0.5) * step):
        R = Rotation.from_euler("ZYZ", np.column_stack([alpha, np.full(alpha.shape, beta), gamma]))
        allowed = tilt_allowed(R, max_tilt)
        column = np.floor((yaw_of(R)[allowed] + np.pi) / turn).astype(np.int64) % edge
        np.maximum.at(values[row], column, correlation[row].ravel()[allowed])
    values[np.isneginf(values)] = np.nan
    return RotationMap(
        values=values,
        tilts=np.rad2deg(np.arange(count + 1) * step),
        yaws=np.rad2deg(np.arange(edge + 1) * turn - np.pi),
    )


def yaw_of(R_target_source: Rotation) -> np.ndarray:
    """The yaw of rotations, () or (n,) [rad], -pi..pi: where the source's x axis points on the target's plane."""
    forward = R_target_source.apply([1.0, 0.0, 0.0])
    return np.arctan2(forward[..., 1], forward[..., 0])


def tilt_of(R_target_source: Rotation) -> np.ndarray:
    """The angle between the z axes, () or (n,) [rad], 0..pi."""
    up = R_target_source.apply([0.0, 0.0, 1.0])
    return np.arccos(np.clip(up[..., 2], -1.0, 1.0))
