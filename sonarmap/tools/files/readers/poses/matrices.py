"""Rigid transforms from the matrices of files."""

from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.limits import LARGEST, require_within

ORTHONORMAL = 1e-3  # what rounding to few digits may do to R R^T: more is not a rotation


def rotation_faults(R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far (N, 3, 3) matrices are from rotations: the largest |R R^T - 1| and the determinant, (N,) each."""
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    # not by np.linalg.det, which divides by pivots however small
    return off, np.einsum("ni,ni->n", np.cross(R[:, 0], R[:, 1]), R[:, 2])


def rigid_transform(rows: Any, what: str) -> RigidTransform:
    """The transform of a matrix (4, 4), its rotation the nearest one.

    Args:
        rows: of the matrix.
        what: of what it is, for messages.

    Raises:
        InputError: another shape, numbers beyond any use, or no rigid transform.
        ValueError, TypeError: no numbers.
    """
    matrix = np.array(rows, np.float64)
    if matrix.shape != (4, 4):
        raise InputError(f"the matrix of {what} has shape {matrix.shape}; wanted (4, 4)")
    require_within(f"the matrix of {what}", matrix, LARGEST)
    (off,), (determinant,) = rotation_faults(matrix[None, :3, :3])
    if off > ORTHONORMAL or determinant < 0 or not np.allclose(matrix[3], [0, 0, 0, 1], atol=1e-6):
        raise InputError(
            f"the matrix of {what} is not a rigid transform (its rotation is off by {off:.2g}, its determinant should "
            "be 1, its last row 0 0 0 1); wanted a rotation and a translation in meters"
        )
    return RigidTransform.from_components(matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]))
