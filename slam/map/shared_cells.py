"""Which scans occupy the same cells under given poses."""

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.spatial.transform import RigidTransform

from slam.map.cell import cell_keys, cell_means, lattice_origin
from spectral.scan import Scan


def outline(scan: Scan, cell: float) -> np.ndarray:
    """(K, 3) float64 [m, sensor frame]: one point for every eighth of a cell that the scan occupies, their mean."""
    return cell_means(scan.points, cell / 2)


def predict_overlap(outlines: Sequence[np.ndarray], T_world_sensor: RigidTransform, cell: float) -> np.ndarray:
    """The share of cells that two scans have in common: (N, N) float64, 0..1, the smaller of both ways.

    Points a million cells away from the first scan, stray echoes, do not count.

    Args:
        outlines: of N scans, (K, 3) each [m, sensor frame].
        T_world_sensor: their poses as estimated, in one frame.
        cell: edge of a cell [m].
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
    return (incidence @ incidence.T).toarray() / np.maximum(np.maximum(counts[:, None], counts), 1)
