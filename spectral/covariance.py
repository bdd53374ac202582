"""Covariances of T_target_source, moved from the source's grid center to its sensor."""

import numpy as np


def covariance_at_sensor(about_center: np.ndarray, center: np.ndarray) -> np.ndarray:
    """A covariance carried from the source's grid center to its sensor: the adjoint of that translation.

    Args:
        about_center: (6, 6), rotation first [rad, m], of errors about the grid's center, in the source's axes.
        center: (3,) the grid's center [m, source sensor frame].

    Returns:
        (6, 6), rotation first, body tangent of the source's sensor frame [rad, m].
    """
    x, y, z = center
    shift = np.eye(6)
    shift[3:, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    moved = shift @ about_center @ shift.T
    return (moved + moved.T) / 2
