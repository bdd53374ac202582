"""Points sorted into the cubes of a world-wide lattice."""

import numpy as np

BITS = 21  # per axis: three fit one int64, and two million cells along an axis
_HALF = 1 << (BITS - 1)


def lattice_origin(points: np.ndarray, size: float) -> np.ndarray:
    """(3,) [m], the corner of a cell in the midst of points (N, 3) [m]; stray ones do not move it.

    Corners lie at multiples of `size`, so that the lattice is the same wherever its cells are counted from.
    """
    return np.floor(np.median(points, axis=0) / size) * size


def cell_keys(points: np.ndarray, size: float, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One number per point that tells its cell: equal for points of one cell, ordered by x, then y, then z.

    Points farther than a million cells from the origin along an axis, such as stray echoes, have no number.

    Args:
        points: (N, 3) float [m].
        size: edge of a cell [m].
        origin: (3,) [m], a corner of the lattice near the points: cells are counted from it.

    Returns:
        (K,) int64 of the points within reach, in their order, and (N,) bool, which points these are.
    """
    columns = [np.floor((points[:, axis] - origin[axis]) / size) for axis in range(3)]
    near = np.ones(len(points), bool)
    for column in columns:  # column by column, which is several times faster than row by row
        near &= (column >= -_HALF) & (column < _HALF)
    x, y, z = (column[near].astype(np.int64) + _HALF for column in columns)
    return (x << (2 * BITS)) | (y << BITS) | z, near


def cell_means(points: np.ndarray, size: float) -> np.ndarray:
    """(K, 3) float64 [m]: the mean of the points in each cell, ordered by cell; stray points are left out.

    Args:
        points: (N, 3) float [m], about the origin.
        size: edge of a cell [m].
    """
    points = points.astype(np.float64)
    keys, near = cell_keys(points, size, np.zeros(3))
    names, cell, count = np.unique(keys, return_inverse=True, return_counts=True)
    sums = [np.bincount(cell, points[near, axis], len(names)) for axis in range(3)]
    return np.column_stack(sums) / count[:, None]
