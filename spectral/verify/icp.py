"""Point-to-plane refinement of a registration, both ways, on smoothed surfaces: sub-voxel, sub-bin.

The iterative closest point of Chen and Medioni (1992, DOI 10.1016/0262-8856(92)90066-C) with the weights of Geman and
McClure, which leave out what only one scan shows. It refines a pose that the spectra found; it does not find one.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from spectral.nearest import query_on_all_cores
from spectral.prepare.surface import Surface

# The width of the weights' bell, as a share of how far apart points may be.
_BELL = 1 / 6
# More points than this are worth a thread for every core.
_MANY = 2000


@dataclass(frozen=True, slots=True)
class Fit:
    """Where the refinement ended.

    Attributes:
        R, shift: p_target = R p_source + shift about the grid centers [voxels].
        information: (6, 6) how well the planes that both scans show fix the pose: the Hessian of the weighted squared
            distances [voxels^2], rotation first, of a turn of the target's axes about the source's grid center and a
            shift along them. Where nothing is fixed its eigenvalues may fall a little below 0.
        residual: weighted root mean square distance to the planes [voxels].
        pairs: number of pairs of points, weighted.
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
        reaches: how far apart points of a pair may be, step by step [voxels].
        most: how many points of each scan are used.
    """
    source_points, source_normals = _thin(source, most)
    target_points, target_normals = _thin(target, most)
    fit = Fit(R, shift, np.zeros((6, 6)), 0.0, 0.0)
    for reach in reaches:
        turn = fit.R.as_matrix()
        moved = source_points @ turn.T + fit.shift
        near, there = _nearest(target, moved, reach)
        normals = target.normals[there]
        onto_target = _Pairs(
            places=moved[near],
            normals=normals,
            others=source_normals[near] @ turn.T,
            gaps=_along(moved[near] - target.points[there], normals),
        )
        near, there = _nearest(source, (target_points - fit.shift) @ turn, reach)
        places, normals = source.points[there] @ turn.T + fit.shift, source.normals[there] @ turn.T
        onto_source = _Pairs(places, normals, target_normals[near], _along(places - target_points[near], normals))
        fit = _step(fit, onto_target.joined(onto_source), reach * _BELL)
    return fit


@dataclass(frozen=True, slots=True)
class _Pairs:
    """n pairs of nearest points of both scans, in the target's axes.

    Attributes:
        places: (n, 3) of the source's points [voxels].
        normals: (n, 3) of the surface whose plane they are to lie in.
        others: (n, 3) of the other scan's surface there, of either sign.
        gaps: (n,) how far they stand off that plane [voxels].
    """

    places: np.ndarray
    normals: np.ndarray
    others: np.ndarray
    gaps: np.ndarray

    def joined(self, more: "_Pairs") -> "_Pairs":
        """Both together."""
        return _Pairs(
            np.vstack([self.places, more.places]),
            np.vstack([self.normals, more.normals]),
            np.vstack([self.others, more.others]),
            np.concatenate([self.gaps, more.gaps]),
        )


def _nearest(surface: Surface, points: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Which points (n,) bool have a point of the surface within reach, and which it is, for those."""
    if len(points) > _MANY:
        distance, index = query_on_all_cores(surface.tree, points, reach=reach)
    else:
        distance, index = surface.tree.query(points, distance_upper_bound=reach)
    near = np.isfinite(distance)
    return near, index[near]


def _step(fit: Fit, pairs: _Pairs, bell: float) -> Fit:
    """One Gauss-Newton step on the distances along the normals."""
    weights = 1.0 / (1.0 + (pairs.gaps / bell) ** 2) ** 2
    arms = pairs.places - fit.shift
    J = np.hstack([np.cross(arms, pairs.normals), pairs.normals])
    weighted = J * weights[:, None]
    hessian = weighted.T @ J
    # what nothing fixes stays where it is
    damped = hessian + 1e-9 * (np.trace(hessian) + 1e-9) * np.eye(6)
    step = -np.linalg.solve(damped, weighted.T @ pairs.gaps)
    total = float(weights.sum())
    residual = float(np.sqrt((weights * pairs.gaps**2).sum() / total)) if total > 0 else 0.0
    return Fit(
        R=Rotation.from_rotvec(step[:3]) * fit.R,
        shift=fit.shift + step[3:],
        information=_shared_information(weighted, arms, pairs),
        residual=residual,
        pairs=total,
    )


def _shared_information(weighted: np.ndarray, arms: np.ndarray, pairs: _Pairs) -> np.ndarray:
    """The Hessian from one scan's normals times the other's.

    Normals of noisy points point everywhere a little, and the sum of their squares finds information along a plane
    that has none. The noise of two scans is independent: in products of both it averages out.
    """
    others = pairs.others * np.sign(_along(pairs.normals, pairs.others))[:, None]
    product = weighted.T @ np.hstack([np.cross(arms, others), others])
    return (product + product.T) / 2


def _thin(surface: Surface, most: int) -> tuple[np.ndarray, np.ndarray]:
    step = max(1, -(-len(surface.points) // most))
    return surface.points[::step], surface.normals[::step]


def _along(vectors: np.ndarray, normals: np.ndarray) -> np.ndarray:
    return np.einsum("ni,ni->n", vectors, normals)
