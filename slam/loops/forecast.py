"""How much two scans will turn out to share, by where they are thought to be and how sure that is."""

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.spatial.transform import RigidTransform

from slam.map.cell import cell_keys, cell_means, lattice_origin
from spectral.scan import Scan

# Draws from the joint marginal of two poses, the mean aside; always the same ones.
_DRAWS = np.random.default_rng(0).standard_normal((12, 6))


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


def sureness(
    target: np.ndarray, source: np.ndarray, T_i_j: RigidTransform, covariance: np.ndarray, cell: float
) -> float:
    """What is left of an overlap when the poses are not where they are thought to be, 0..1.

    The mean share of cells in common over draws from the estimate's uncertainty, against that at the estimate.

    Args:
        target, source: outlines of scans i and j.
        T_i_j: as estimated.
        covariance: (6, 6) of it, from the joint marginal of both poses.
        cell: edge of the cells in which scans are compared [m].
    """
    draws = RigidTransform.from_exp_coords(_DRAWS @ np.linalg.cholesky(covariance).T)
    occupied = np.unique(cell_keys(target, cell, np.zeros(3))[0])
    keys, _ = cell_keys(T_i_j.apply(source), cell, np.zeros(3))
    sure = int(np.isin(keys, occupied).sum())
    if not sure:
        return 0.0
    moved = np.concatenate([T.apply(source) for T in T_i_j * draws])
    shared = np.isin(cell_keys(moved, cell, np.zeros(3))[0], occupied).sum() / len(_DRAWS)
    return float(min(1.0, shared / sure))
