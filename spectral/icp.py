"""Point-to-plane refinement of a registration, both ways, on smoothed surfaces: sub-voxel, sub-bin.

The iterative closest point of Chen and Medioni (1992, DOI 10.1016/0262-8856(92)90066-C) with the weights of Geman and
McClure, which leave out what only one scan shows. It only polishes: the spectra have to find the place.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from spectral.surface import Surface

# The width of the weights' bell, as a share of how far apart points may be.
_BELL = 1 / 6


@dataclass(frozen=True, slots=True)
class Fit:
    """Where the refinement ended.

    Attributes:
        R, shift: p_target = R p_source + shift about the grid centers [voxels].
        information: (6, 6) Gauss-Newton Hessian of the weighted squared distances [voxels^2], rotation first, of a turn
            of the target's axes about the source's grid center and a shift along them.
        residual: weighted root mean square distance to the planes [voxels].
        pairs: how many pairs of points took part, weighted.
    """

    R: Rotation
    shift: np.ndarray
    information: np.ndarray
    residual: float
    pairs: float


def refine(
    target: Surface, source: Surface, R: Rotation, shift: np.ndarray, reaches: tuple[float, ...], most: int
) -> Fit:
    """Gauss-Newton from the given place, one step for each reach.

    Args:
        R, shift: p_target = R p_source + shift about the grid centers [voxels].
        reaches: how far apart points may be that are taken for the same, step by step [voxels].
        most: points of each scan that take part.
    """
    source_points = _thin(source, most)
    target_points = _thin(target, most)
    fit = Fit(R, shift, np.zeros((6, 6)), 0.0, 0.0)
    for reach in reaches:
        turn = fit.R.as_matrix()
        moved = source_points @ turn.T + fit.shift
        distance, nearest = target.tree.query(moved, distance_upper_bound=reach)
        near = np.isfinite(distance)
        places, normals = [moved[near]], [target.normals[nearest[near]]]
        gaps = [_along(places[0] - target.points[nearest[near]], normals[0])]
        back = (target_points - fit.shift) @ turn
        distance, nearest = source.tree.query(back, distance_upper_bound=reach)
        near = np.isfinite(distance)
        places.append(source.points[nearest[near]] @ turn.T + fit.shift)
        normals.append(source.normals[nearest[near]] @ turn.T)
        gaps.append(_along(places[1] - target_points[near], normals[1]))
        fit = _step(fit, np.vstack(places), np.vstack(normals), np.concatenate(gaps), reach * _BELL)
    return fit


def _step(fit: Fit, places: np.ndarray, normals: np.ndarray, gaps: np.ndarray, bell: float) -> Fit:
    """One Gauss-Newton step on the distances along the normals."""
    weights = 1.0 / (1.0 + (gaps / bell) ** 2) ** 2
    J = np.hstack([np.cross(places - fit.shift, normals), normals])
    information = (J * weights[:, None]).T @ J
    gradient = J.T @ (weights * gaps)
    # what nothing fixes stays where it is
    damped = information + 1e-9 * (np.trace(information) + 1e-9) * np.eye(6)
    step = -np.linalg.solve(damped, gradient)
    total = float(weights.sum())
    residual = float(np.sqrt((weights * gaps**2).sum() / total)) if total > 0 else 0.0
    return Fit(Rotation.from_rotvec(step[:3]) * fit.R, fit.shift + step[3:], information, residual, total)


def _thin(surface: Surface, most: int) -> np.ndarray:
    return surface.points[:: max(1, -(-len(surface.points) // most))]


def _along(vectors: np.ndarray, normals: np.ndarray) -> np.ndarray:
    return np.einsum("ni,ni->n", vectors, normals)
