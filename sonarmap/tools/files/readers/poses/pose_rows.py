"""What the files of poses have in common: lines of finite numbers, quaternions among them, and matrices."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.rows import Line, parse_rows, whole_lines
from sonarmap.tools.files.readers.instruments import LARGEST, LEAST_SIGMA, largest_of
from sonarmap.tools.files.user_file import naming, read_content

ORTHONORMAL = 1e-3  # what rounding to few digits may do to R R^T: more is not a rotation


def read_lines(path: Path) -> list[Line]:
    """The lines of a file that are neither blank nor comments ('#'), with their numbers. Raises InputError: the file
    cannot be read, is empty, or its last line has no end and may have been cut."""
    content = read_content(Path(path))
    with naming(path):
        lines = [line for line in whole_lines(content, 1) if not line[1].lstrip().startswith(b"#")]
    if not lines:
        raise InputError(f"{path} holds no line but comments; wanted poses")
    return lines


def finite_rows(path: Path, lines: list[Line], layout: str) -> np.ndarray:
    """Numbers in rows, as many as `layout` has words: (N, words) float64. Raises InputError: naming the line that has
    more or fewer columns, something that is no number, NaN, infinity, or a number beyond its column's `largest_of`."""
    try:
        rows = parse_rows(lines, len(layout.split()))
    except InputError as error:
        raise InputError(f"{path}: {error}. Each holds: {layout}") from error
    bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if len(bad):
        raise InputError(f"{path}: line {lines[bad[0]][0]} holds NaN or infinity; wanted finite numbers: {layout}")
    largest = np.array([largest_of(column) for column in layout.split()])
    beyond = np.argwhere(np.abs(rows) > largest)
    if len(beyond):
        row, column = beyond[0].tolist()
        raise InputError(
            f"{path}: line {lines[row][0]} holds {rows[row, column]:g}; wanted {layout.split()[column]} within "
            f"{largest[column]:g}: fix that line"
        )
    return rows


def transforms(path: Path, lines: list[Line], rows: np.ndarray) -> RigidTransform:
    """N rigid transforms from (N, 7) rows: x y z [m], then a quaternion x y z w of any length but (nearly) zero. Raises
    InputError: naming the line of a zero quaternion."""
    zero = np.flatnonzero(np.linalg.norm(rows[:, 3:], axis=1) < LEAST_SIGMA)
    if len(zero):
        raise InputError(f"{path}: line {lines[zero[0]][0]} holds a zero quaternion; no rotation is 0 0 0 1")
    return RigidTransform.from_components(rows[:, :3], Rotation.from_quat(rows[:, 3:]))


def rotation_faults(R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far (N, 3, 3) matrices are from rotations: the largest |R R^T - 1| and the determinant, (N,) each."""
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    # not by np.linalg.det, which divides by pivots however small
    return off, np.einsum("ni,ni->n", np.cross(R[:, 0], R[:, 1]), R[:, 2])


def rigid_transform(rows: Any, what: str) -> RigidTransform:
    """The transform of a matrix (4, 4) of `what`, its rotation the nearest one. Raises InputError: another shape,
    numbers beyond any use, or no rigid transform; ValueError, TypeError: no numbers."""
    matrix = np.array(rows, np.float64)
    if matrix.shape != (4, 4):
        raise InputError(f"the matrix of {what} has shape {matrix.shape}; wanted (4, 4)")
    bad = matrix[~(np.abs(matrix) <= LARGEST)]  # NaN too
    if len(bad):
        raise InputError(f"the matrix of {what} holds {bad[0]:g}; wanted numbers within {LARGEST:g}")
    (off,), (determinant,) = rotation_faults(matrix[None, :3, :3])
    if off > ORTHONORMAL or determinant < 0 or not np.allclose(matrix[3], [0, 0, 0, 1], atol=1e-6):
        raise InputError(
            f"the matrix of {what} is not a rigid transform (its rotation is off by {off:.2g}, its determinant should "
            "be 1, its last row 0 0 0 1); wanted a rotation and a translation in meters"
        )
    return RigidTransform.from_components(matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]))
