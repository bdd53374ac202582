"""How certain an expected overlap is, by the uncertainty of the estimate that it comes from."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from slam.map.cell import cell_keys

# Draws from the joint marginal of two poses, the mean aside; always the same.
_DRAWS = np.random.default_rng(0).standard_normal((12, 6))


def certainty(
    target: np.ndarray, source: np.ndarray, T_i_j: RigidTransform, covariance: np.ndarray, cell: float
) -> float:
    """The share of an expected overlap that is left, 0..1, as the poses may not be where the estimate has them.

    The mean number of cells in common over draws from the estimate's uncertainty, over that at the estimate.

    Args:
        target, source: outlines of scans i and j (`slam.map.shared_cells.outline`).
        T_i_j: as estimated.
        covariance: (6, 6) of it, from the joint marginal of both poses.
        cell: edge of the cells in which scans are compared [m].
    """
    draws = RigidTransform.from_exp_coords(_DRAWS @ np.linalg.cholesky(covariance).T)
    occupied = np.unique(cell_keys(target, cell, np.zeros(3))[0])
    keys, _ = cell_keys(T_i_j.apply(source), cell, np.zeros(3))
    at_estimate = int(np.isin(keys, occupied).sum())
    if not at_estimate:
        return 0.0
    moved = np.concatenate([T.apply(source) for T in T_i_j * draws])
    mean = np.isin(cell_keys(moved, cell, np.zeros(3))[0], occupied).sum() / len(_DRAWS)
    return float(min(1.0, mean / at_estimate))
