"""Covariances of T_target_source, moved from the source's grid center to its sensor."""

import numpy as np


def covariance_at_sensor(about_center: np.ndarray, center: np.ndarray) -> np.ndarray:
    """(6, 6), rotation first, body tangent of the source's sensor frame [rad, m]: by the adjoint of a translation.

    From errors (6, 6) about the source's grid center, in its axes; the center is (3,) [m, source sensor frame].
    """
    shift = np.eye(6)
    shift[3:, :3] = cross_matrices(center[None])[0]
    moved = shift @ about_center @ shift.T
    return (moved + moved.T) / 2


def cross_matrices(vectors: np.ndarray) -> np.ndarray:
    """(N, 3, 3) by which a vector is multiplied to get the cross product of each of (N, 3) with it."""
    x, y, z = vectors.T
    nothing = np.zeros_like(x)
    return np.moveaxis(np.array([[nothing, -z, y], [z, nothing, -x], [-y, x, nothing]]), 2, 0)
