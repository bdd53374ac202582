"""How certain an expected overlap is, by the uncertainty of the estimate that it comes from."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.map.cell import cell_keys

# Draws from the joint marginal of two poses, the mean aside; always the same.
_DRAWS = np.random.default_rng(0).standard_normal((12, 6))


def certainties(
    outlines: Sequence[np.ndarray], pairs: np.ndarray, T: RigidTransform, covariances: np.ndarray, cell: float
) -> np.ndarray:
    """(m,) the shares of expected overlaps that are left, 0..1, as the poses may not be where the estimate has them.

    The mean number of cells in common over draws from the estimate's uncertainty, over that at the estimate.

    Args:
        outlines: of N scans (`slam.map.cell.outline`).
        pairs: (m, 2) int, scans i and j.
        T: T_i_j, m of them, as estimated.
        covariances: (m, 6, 6) of them, from the joint marginals of both poses.
        cell: edge of the cells in which scans are compared [m].
    """
    if not len(pairs):
        return np.zeros(0)
    tangents = np.einsum("nab,kb->nka", np.linalg.cholesky(covariances), _DRAWS).reshape(-1, 6)
    matrices = T.as_matrix()
    draws = matrices[:, None] @ RigidTransform.from_exp_coords(tangents).as_matrix().reshape(len(pairs), -1, 4, 4)
    occupied: dict[int, np.ndarray] = {}
    result = np.zeros(len(pairs))
    for k, (i, j) in enumerate(pairs.tolist()):
        if i not in occupied:
            occupied[i] = np.unique(_keys(outlines[i], cell))
        at_estimate, *drawn = (
            _common(occupied[i], outlines[j] @ moved[:3, :3].T + moved[:3, 3], cell)
            for moved in (matrices[k], *draws[k])
        )
        if at_estimate:
            result[k] = min(1.0, sum(drawn) / len(drawn) / at_estimate)
    return result


def _common(occupied: np.ndarray, points: np.ndarray, cell: float) -> int:
    """How many points lie in cells of these sorted keys."""
    keys = _keys(points, cell)
    place = np.minimum(np.searchsorted(occupied, keys), len(occupied) - 1)
    return int(np.count_nonzero(occupied[place] == keys))


def _keys(points: np.ndarray, cell: float) -> np.ndarray:
    return cell_keys(points, cell, np.zeros(3))[0]


def displacement(outlines: Sequence[np.ndarray], pairs: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """(m,) how far points of scan j usually are from where an estimate has them against scan i: root mean squares [m].

    Args:
        outlines: of N scans.
        pairs: (m, 2) int, scans i and j.
        covariances: (m, 6, 6) of T_i_j.
    """
    lever = np.array([np.einsum("na,nb->ab", points, points) / len(points) for points in outlines])
    middle = np.array([points.mean(axis=0) for points in outlines])
    # of w x p + v over all points: the mean of |w x p|^2 is that of w' (p'p I - p p') w
    j = pairs[:, 1]
    turned = np.trace(lever[j], axis1=1, axis2=2)[:, None, None] * np.eye(3) - lever[j]
    turn, cross, shift = covariances[:, :3, :3], covariances[:, :3, 3:], covariances[:, 3:, 3:]
    both = np.stack([cross[:, 1, 2] - cross[:, 2, 1], cross[:, 2, 0] - cross[:, 0, 2], cross[:, 0, 1] - cross[:, 1, 0]])
    squares = np.einsum("nab,nab->n", turned, turn) - 2 * np.einsum("an,na->n", both, middle[j])
    return np.sqrt(np.maximum(squares + np.trace(shift, axis1=1, axis2=2), 0.0))
