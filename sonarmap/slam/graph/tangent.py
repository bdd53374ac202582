"""Tangents and their covariances: propagation between frames, and Mahalanobis lengths, many at a time."""

import math

import numpy as np
from scipy.spatial.transform import RigidTransform


def adjoint(T: RigidTransform) -> np.ndarray:
    """(..., 6, 6), rotation first: T Exp(xi) = Exp(adjoint(T) xi) T, as gtsam.Pose3.AdjointMap."""
    matrices = T.as_matrix()
    R, t = matrices[..., :3, :3], matrices[..., :3, 3]
    cross = np.cross(t[..., None, :], R.swapaxes(-1, -2)).swapaxes(-1, -2)
    result = np.zeros((*matrices.shape[:-2], 6, 6))
    result[..., :3, :3] = result[..., 3:, 3:] = R
    result[..., 3:, :3] = cross
    return result


def propagated(T: RigidTransform, covariance: np.ndarray) -> np.ndarray:
    """(..., 6, 6) covariances of adjoint(T) xi, from those of xi."""
    A = adjoint(T)
    return A @ covariance @ A.swapaxes(-1, -2)


def upward(T_world_body: RigidTransform, points: np.ndarray) -> np.ndarray:
    """(n, 6) derivative of the heights of world points (n, 3) with respect to the body tangents (w, v) of n poses.

    With T Exp((w, v)) a point p of the body moves by R (w x p + v), whose third component is w . (p x up) + v . up.
    """
    T_body_world = T_world_body.inv()
    up = T_body_world.rotation.apply([0.0, 0.0, 1.0])
    return np.hstack([np.cross(T_body_world.apply(points), up), up])


def lengths(xi: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(m,) Mahalanobis lengths of tangents (m, 6) under their covariances (m, 6, 6) [sigmas]."""
    return np.sqrt(np.einsum("na,na->n", xi, np.linalg.solve(covariance, xi[:, :, None])[:, :, 0]))


def worst_sigmas(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The standard deviations of covariances (..., 6, 6), rotation first, along their worst directions.

    Returns:
        of the rotation [rad] and of the translation [m], (...) each: the roots of the largest eigenvalues of the two
        diagonal blocks, which no choice of axes changes.
    """
    blocks = covariance[..., :3, :3], covariance[..., 3:, 3:]
    rotation, translation = (np.sqrt(np.linalg.eigvalsh(block)[..., -1]) for block in blocks)
    return rotation, translation


def sigma_words(covariances: np.ndarray) -> str:
    """The largest standard deviations of covariances (..., 6, 6), rotation first [rad, m], in words."""
    turn, shift = (float(np.max(each)) for each in worst_sigmas(covariances))
    return f"{shift:.3f} m and {math.degrees(turn):.2f}° in the worst direction"
