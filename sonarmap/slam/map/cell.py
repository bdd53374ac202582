"""Cells of a world-wide cubic lattice: the points in them, and the overlap of scans under given poses."""

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.scan import Scan

BITS = 21  # of a key per axis: an int64 holds three axes of two million cells each
_HALF = 1 << (BITS - 1)


def lattice_origin(points: np.ndarray, size: float) -> np.ndarray:
    """(3,) [m], the corner of the cell at the median of points (N, 3) [m], which stray points do not move.

    Corners lie at multiples of `size`, so that the lattice is the same for every origin.
    """
    return np.floor(np.median(points, axis=0) / size) * size


def cell_keys(points: np.ndarray, size: float, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One key per point: equal for points of one cell, ordered by x, then y, then z.

    Points farther than a million cells from the origin along an axis, such as stray echoes, have no key.

    Args:
        points: (N, 3) float [m].
        size: edge of a cell [m].
        origin: (3,) [m], a corner of the lattice near the points: cells are counted from it.

    Returns:
        (K,) int64 keys of the points within reach, in their order, and (N,) bool, which points these are.
    """
    columns = [np.floor((points[:, axis] - origin[axis]) / size) for axis in range(3)]
    near = np.ones(len(points), bool)
    for column in columns:  # column by column, which is several times faster than row by row
        near &= (column >= -_HALF) & (column < _HALF)
    x, y, z = (column[near].astype(np.int64) + _HALF for column in columns)
    return (x << (2 * BITS)) | (y << BITS) | z, near


def cell_means(points: np.ndarray, size: float) -> np.ndarray:
    """(K, 3) float64 [m]: the mean of the (N, 3) points [m] in each occupied cell with an edge of `size` [m], ordered
    by cell; points more than a million cells from 0 are left out."""
    points = points.astype(np.float64)
    keys, near = cell_keys(points, size, np.zeros(3))
    names, cell, count = np.unique(keys, return_inverse=True, return_counts=True)
    sums = [np.bincount(cell, points[near, axis], len(names)) for axis in range(3)]
    return np.column_stack(sums) / count[:, None]


def outline(scan: Scan, cell: float) -> np.ndarray:
    """(K, 3) float64 [m, sensor frame]: the scan's mean point in every occupied cell of half the edge `cell` [m]."""
    return cell_means(scan.points, cell / 2)


def neighbors(numbers: np.ndarray) -> sparse.csr_array:
    """(C, C) matrix that sums each cell and those of the eight around it that are there, by (C, 2) cell numbers."""
    if not len(numbers):
        return sparse.csr_array((0, 0))
    pairs = KDTree(numbers).query_pairs(1.5, output_type="ndarray")
    itself = np.repeat(np.arange(len(numbers))[:, None], 2, axis=1)
    first, second = np.concatenate([pairs, pairs[:, ::-1], itself]).T
    return sparse.csr_array((np.ones(len(first)), (first, second)), shape=(len(numbers), len(numbers)))


def overlapping(
    outlines: Sequence[np.ndarray], T_world_sensor: RigidTransform, cell: float, least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of scans that share cells, (m, 2) int64, i < j, in order, and (m,) float64 their overlap, 0..1, the smaller
    of both ways. Points a million cells away from the first scan, stray echoes, do not count.

    Args:
        outlines: of N scans, (K, 3) each [m, sensor frame].
        T_world_sensor: their poses as estimated, in one frame.
        cell: edge of a cell [m].
        least: smallest overlap of a returned pair, above 0.
    """
    origin = lattice_origin(T_world_sensor[0].apply(outlines[0]), cell)
    occupied = [
        np.unique(cell_keys(T.apply(points), cell, origin)[0])
        for points, T in zip(outlines, T_world_sensor, strict=True)
    ]
    counts = np.array([len(cells) for cells in occupied])
    names, column = np.unique(np.concatenate(occupied), return_inverse=True)
    row = np.repeat(np.arange(len(outlines)), counts)
    incidence = sparse.csr_array((np.ones(len(row)), (row, column)), shape=(len(outlines), len(names)))
    common = sparse.coo_array(incidence @ incidence.T)
    share = common.data / np.maximum(np.maximum(counts[common.row], counts[common.col]), 1)
    chosen = (common.row < common.col) & (share >= least)
    both, share = np.column_stack([common.row, common.col])[chosen].astype(np.int64), share[chosen]
    order = np.lexsort((both[:, 1], both[:, 0]))
    return both[order], share[order]
