"""Point-to-plane refinement of a registration, both ways, on smoothed surfaces: sub-voxel, sub-bin.

The iterative closest point of Chen and Medioni (1992, DOI 10.1016/0262-8856(92)90066-C) with the weights of Geman and
McClure, which leave out what only one scan shows. It refines a pose that the spectra found; it does not find one.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from spectral.nearest import query_on_all_cores
from spectral.prepare.surface import Surface
from spectral.verify.calibration import CALIBRATION
from spectral.verify.prior_term import PriorTerm, posterior_step

# The width of the weights' bell: this share of how far apart points may be, or of how far the surfaces usually are.
_BELL, _WIDE_BELL = 1 / 6, 0.8
# Points as many widths of the bell apart as this no longer count.
_BELLS = 4.0
# How far surfaces usually are apart is measured where points may be at least so far apart [voxels].
_MEASURED = 3.0
# A direction held by less than this share of the planes counts as held by so much.
_LOOSEST = 1e-4
# Information is given as if so many points of each scan took part: `Calibration` is for these.
_FULL = 3000
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
        pairs: number of pairs of points, weighted, as if 3000 points of each scan took part.
        prior: what instruments measured, about the pose before the last step; None where nothing was.
        width: median distance to the planes of all points within 3 voxels and more [voxels]: how far the surfaces are
            apart, by noise, by distortion, or because they are not the same.
        step: (6,) from there to where the scans alone would have it [rad, voxels].
    """

    R: Rotation
    shift: np.ndarray
    information: np.ndarray
    residual: float
    pairs: float
    width: float = 0.0
    prior: PriorTerm | None = None
    step: np.ndarray = field(default_factory=lambda: np.zeros(6))

    def principal(self) -> tuple[np.ndarray, np.ndarray, float]:
        """The information by directions: shares (6,) of a pair's, ascending, their axes (6, 6) in columns, and a lever.

        Turns are taken times the lever [voxels], what they move the points by, so that directions can be compared.
        """
        lever = np.sqrt(max(float(np.trace(self.information[:3, :3])), 1e-12) / max(self.pairs, 1e-12))
        units = np.repeat([lever, 1.0], 3)
        share, axes = np.linalg.eigh(self.information / np.outer(units, units) / max(self.pairs, 1e-12))
        return share, axes, lever

    @property
    def firmness(self) -> float:
        """The geometric mean, over all directions, of how firmly the planes hold the pose; 0..1.

        Two flat places fit anywhere: their planes hold three directions of six.
        """
        return float(np.exp(np.log(np.maximum(self.principal()[0], _LOOSEST)).mean()))

    @property
    def by_scans(self) -> "Fit":
        """Where the scans alone would have the pose."""
        turn, shift = self.step[:3], self.step[3:]
        return replace(self, R=Rotation.from_rotvec(turn) * self.R, shift=self.shift + shift, prior=None)


def refine(
    target: Surface,
    source: Surface,
    R: Rotation,
    shift: np.ndarray,
    reaches: tuple[float, ...],
    most: int,
    width: float = 0.0,
    prior: PriorTerm | None = None,
) -> Fit:
    """Gauss-Newton from the given place, one step for each reach.

    Args:
        R, shift: p_target = R p_source + shift about the grid centers [voxels].
        reaches: how far apart points of a pair may be, step by step [voxels].
        most: how many points of each scan are used.
        width: how far the surfaces usually are apart, as an earlier fit has it [voxels]. Where this is more than the
            reaches leave, points of all that the noise or the distortion moves take part, not of a chance layer.
        prior: what instruments measured, about the pose to begin with; it counts in every step beside the planes.
    """
    source_points, source_normals = _thin(source, most)
    target_points, target_normals = _thin(target, most)
    full = min(len(source.points), _FULL) + min(len(target.points), _FULL)
    scale = full / (len(source_points) + len(target_points))
    fit = Fit(R, shift, np.zeros((6, 6)), 0.0, 0.0, width)
    for tried in reaches:
        bell = max(tried * _BELL, fit.width * _WIDE_BELL)
        reach = max(tried, bell * _BELLS)
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
        pairs = onto_target.joined(onto_source)
        if tried >= _MEASURED and len(pairs.gaps):
            fit = replace(fit, width=float(np.median(np.abs(pairs.gaps))))
        fit = _step(fit, pairs, bell, scale, _prior_at(fit, prior, R, shift))
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


def _prior_at(fit: Fit, prior: PriorTerm | None, R: Rotation, shift: np.ndarray) -> PriorTerm | None:
    """What instruments measured, about where the fit is now, from where it began."""
    if prior is None:
        return None
    return prior.moved(np.concatenate([(fit.R * R.inv()).as_rotvec(), fit.shift - shift]))


def _step(fit: Fit, pairs: _Pairs, bell: float, scale: float, prior: PriorTerm | None) -> Fit:
    """One Gauss-Newton step on the distances along the normals, each pair for `scale` of them."""
    weights = scale / (1.0 + (pairs.gaps / bell) ** 2) ** 2
    arms = pairs.places - fit.shift
    J = np.hstack([np.cross(arms, pairs.normals), pairs.normals])
    weighted = J * weights[:, None]
    hessian, gradient = weighted.T @ J, weighted.T @ pairs.gaps
    total = float(weights.sum())
    residual = float(np.sqrt((weights * pairs.gaps**2).sum() / total)) if total > 0 else 0.0
    alone = posterior_step(hessian, gradient, 1.0, None)
    step = alone if prior is None else posterior_step(hessian, gradient, CALIBRATION.variance(fit.width), prior)
    return Fit(
        R=Rotation.from_rotvec(step[:3]) * fit.R,
        shift=fit.shift + step[3:],
        information=_shared_information(weighted, arms, pairs),
        residual=residual,
        pairs=total,
        width=fit.width,
        prior=prior,
        step=alone,
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
