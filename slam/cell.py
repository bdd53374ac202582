"""Points sorted into the cubes of a world-wide lattice."""

import numpy as np

from kernels.errors import InputError

_BITS = 21  # per axis: three fit one int64, and two million cells along an axis
_HALF = 1 << (_BITS - 1)


def cell_keys(points: np.ndarray, size: float, origin: np.ndarray) -> np.ndarray:
    """One number per point that tells its cell: equal for points of one cell, ordered by x, then y, then z.

    Args:
        points: (N, 3) float [m].
        size: edge of a cell [m].
        origin: (3,) [m], a corner of the lattice near the points: cells are counted from it.

    Returns:
        (N,) int64.

    Raises:
        InputError: points farther from the origin than a million cells.
    """
    cells = np.floor((points - origin) / size).astype(np.int64)
    if len(cells) and (cells.min() < -_HALF or cells.max() >= _HALF):
        reach = float(np.abs(points - origin).max())
        raise InputError(
            f"points lie up to {reach:.3g} m from the map's first pose, more than {_HALF:,} cells of "
            f"{size} m; use larger voxels, or look for a pose that went astray"
        )
    cells += _HALF
    return (cells[:, 0] << (2 * _BITS)) | (cells[:, 1] << _BITS) | cells[:, 2]
