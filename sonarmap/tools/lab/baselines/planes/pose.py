"""From corresponding planes to the transform between two scans, in closed form, and its covariance.

Pathak, Birk, Vaskevicius, Poppinga: Fast registration based on noisy planes with unknown correspondences for 3D
mapping. IEEE Transactions on Robotics 26(3), 2010, DOI 10.1109/TRO.2010.2042989.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.baselines.planes.fit import Patches, tangents

# What no plane determines is as uncertain as an angle that may be anything [rad].
LOOSE_ROTATION = float(np.pi / np.sqrt(3))
# Normals (M, 3) whose singular value along a direction is below this do not fix the translation along it: of three
# planes the third leans less than 12 degrees out of the way of the others. Their noise alone would seem to.
_LEAST_SINGULAR = 0.2
_STEPS = 2
_HALVINGS = 6


@dataclass(frozen=True, slots=True)
class PlanePose:
    """A transform from corresponding planes."""

    T_target_source: RigidTransform  # the transform [m]
    covariance: np.ndarray  # (6, 6), rotation first [rad, m], of xi in T_target_source Exp(xi)


@dataclass(frozen=True, slots=True)
class Slack:
    """What two fits of one surface may differ by besides their covariances, since it is not quite plane."""

    # [rad], the largest standard deviation about either direction within the plane; that of a wide patch is less, half
    # the shift over its radius
    turn: float
    shift: float  # [m], standard deviation along the normal, midway between the middles of both patches

    def times(self, share: float) -> Slack:
        """A share of it."""
        return Slack(self.turn * share, self.shift * share)


NO_SLACK = Slack(0.0, 0.0)


def closed_form(target: Patches, source: Patches) -> RigidTransform:
    """T_target_source from M >= 1 pairs of corresponding planes, weighed by their covariances.

    Directions of translation that the planes leave open are such that the middles of the patches, weighed by
    their areas, come as close as they can; an open turn (all planes parallel) is the smallest.
    """
    R = closed_rotation(target, source)
    return RigidTransform.from_components(closed_translation(target, source, R), R)


def closed_rotation(target: Patches, source: Patches) -> Rotation:
    """R_target_source that brings the source's normals best to the target's: Davenport's q method.

    The largest eigenvector of the quaternion form of Wahba's problem, each pair weighed by the inverse trace of its
    normals' covariances; of a plane of such eigenvectors the smallest rotation.
    """
    trace = np.trace(target.covariance[:, :3, :3] + source.covariance[:, :3, :3], axis1=1, axis2=2)
    weight = 1 / np.maximum(trace, 1e-12)
    B = (weight[:, None] / weight.sum() * target.normal).T @ source.normal
    axis = np.array([B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1]])
    K = np.empty((4, 4))  # quaternions (x, y, z, w)
    K[:3, :3] = B + B.T - np.trace(B) * np.eye(3)
    K[:3, 3] = K[3, :3] = axis
    K[3, 3] = np.trace(B)
    values, vectors = np.linalg.eigh(K)
    best = vectors[:, values >= values[-1] - 1e-9]
    return Rotation.from_quat(best @ best[3] if np.linalg.norm(best[3]) > 1e-9 else best[:, -1])


def closed_translation(target: Patches, source: Patches, R: Rotation) -> np.ndarray:
    """t (3,) [m] of weighted least squares n . t = d_target - d_source, given R_target_source."""
    variance = target.covariance[:, 3, 3] + source.covariance[:, 3, 3]
    weight = 1 / np.sqrt(np.maximum(variance, 1e-12))
    seen, _ = fixed_and_open(target.normal)
    rows = weight[:, None] * (target.normal @ seen.T)
    known = np.linalg.lstsq(rows, weight * (target.distance - source.distance), rcond=None)[0] @ seen
    area = np.minimum(target.area, source.area)
    apart = area @ (target.middle - R.apply(source.middle)) / area.sum()
    return known + apart - seen.T @ (seen @ apart)


def fixed_and_open(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The directions (f, 3) along which planes of normals (M, 3) fix a translation, and the others (3 - f, 3)."""
    _, values, directions = np.linalg.svd(normal, full_matrices=True)
    values = np.append(values, np.zeros(3 - len(values)))
    return directions[values >= _LEAST_SINGULAR], directions[values < _LEAST_SINGULAR]


def refine(target: Patches, source: Patches, start: RigidTransform, loose: float, slack: Slack) -> PlanePose:
    """The most likely transform near `start`, rotation and translation together, and its covariance.

    Normal and distance of a plane err together (a plane turned about its middle moves away from the sensor), which
    the closed form in two steps leaves out. Gauss-Newton on (n, d) with all of both covariances. What the planes
    leave open stays at the start.

    Args:
        target, source: M >= 1 pairs of corresponding planes.
        start: T_target_source to begin from.
        loose: standard deviation [m] of a translation that no plane determines; a rotation's is LOOSE_ROTATION.
        slack: what the planes of one surface differ by besides their covariances.
    """
    T, fixed, still = start, *_tangent_space(source.normal, loose)
    for _ in range(_STEPS):
        information, gradient, _ = _normal_equations(_linearize(target, source, T), slack)
        step = np.linalg.lstsq(fixed @ information @ fixed.T, fixed @ gradient, rcond=None)[0]
        T = T * RigidTransform.from_exp_coords(-step @ fixed)
    information, _, chi2 = _normal_equations(_linearize(target, source, T), slack)
    freedom = 3 * len(target) - len(fixed)
    scatter = max(1.0, float(chi2.sum()) / freedom) if freedom > 0 else 1.0
    widest = fixed @ np.diag([LOOSE_ROTATION**-2] * 3 + [loose**-2] * 3) @ fixed.T
    known = np.linalg.inv(fixed @ information @ fixed.T / scatter + widest)
    covariance = fixed.T @ known @ fixed + still
    return PlanePose(T, (covariance + covariance.T) / 2)


def _tangent_space(normal: np.ndarray, loose: float) -> tuple[np.ndarray, np.ndarray]:
    """The directions (f, 6) of xi that planes of normals (M, 3) fix, and the covariance (6, 6) of the others."""
    seen, hidden = fixed_and_open(normal)
    # planes that are all parallel leave the turn about their normal open
    turns, turn = (np.eye(3), np.empty((0, 3))) if len(seen) > 1 else (hidden, seen)
    fixed = np.zeros((len(turns) + len(seen), 6))
    fixed[: len(turns), :3], fixed[len(turns) :, 3:] = turns, seen
    still = np.zeros((6, 6))
    still[:3, :3] = LOOSE_ROTATION**2 * turn.T @ turn
    still[3:, 3:] = loose**2 * hidden.T @ hidden
    return fixed, still


def settle(target: Patches, source: Patches, start: RigidTransform, loose: float, slack: Slack) -> PlanePose:
    """As `refine`, with no more of the slack than the residuals ask for.

    Surfaces that are not quite plane disagree by more than their covariances say, when other parts of them are seen;
    planes do not.
    """
    pose = refine(target, source, start, loose, slack)
    for _ in range(_STEPS):
        share = _slack_needed(_linearize(target, source, pose.T_target_source), slack)
        pose = refine(target, source, pose.T_target_source, loose, slack.times(share))
    return pose


def compare(target: Patches, source: Patches, T: RigidTransform, slack: Slack) -> np.ndarray:
    """(M,) squared Mahalanobis distances of pairs of planes under T, three degrees of freedom each."""
    return _normal_equations(_linearize(target, source, T), slack)[2]


@dataclass(frozen=True, slots=True)
class _Linear:
    """Residuals (M, 3), their Jacobians (M, 3, 6) in xi, covariances (M, 3, 3), levers of the slack (M, 3, 3)
    and radii (M,) of the smaller patches [m]."""

    residual: np.ndarray
    jacobian: np.ndarray
    covariance: np.ndarray
    lever: np.ndarray
    radius: np.ndarray


def _linearize(target: Patches, source: Patches, T: RigidTransform) -> _Linear:
    """With T Exp(xi), xi = (w, v): n = R n_s turns by R (w x n_s), d = d_s + n . t grows by
    w . (n_s x R^T t) + n_s . v."""
    R, t = T.rotation.as_matrix(), T.translation
    normal = source.normal @ R.T
    basis = tangents(target.normal)
    transposed = np.swapaxes(basis, 1, 2)
    across = np.concatenate([target.normal - normal, (target.distance - source.distance - normal @ t)[:, None]], axis=1)
    jacobian = np.zeros((len(target), 4, 6))
    jacobian[:, :3, :3] = R @ np.cross(np.eye(3), source.normal[:, None])  # [n]x
    jacobian[:, 3, :3] = -np.cross(source.normal, R.T @ t)
    jacobian[:, 3, 3:] = -source.normal
    moved = np.zeros((4, 4))
    moved[:3, :3], moved[3, :3], moved[3, 3] = R, t @ R, 1.0
    covariance = transposed @ (target.covariance + moved @ source.covariance @ moved.T) @ basis
    # a turn about the point midway between both patches moves d by n . midway
    midway = (target.middle + T.apply(source.middle)) / 2
    lever = np.tile(np.eye(3), (len(target), 1, 1))
    lever[:, 2, :2] = np.einsum("mik,mi->mk", basis[:, :3, :2], midway)
    radius = np.sqrt(np.minimum(target.area, source.area) / np.pi)
    return _Linear(np.einsum("mik,mi->mk", basis, across), transposed @ jacobian, covariance, lever, radius)


def _normal_equations(linear: _Linear, slack: Slack) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Information (6, 6), gradient (6,) and the chi-squared (M,) of every pair."""
    turn = np.minimum(slack.turn, slack.shift / (2 * linear.radius))
    deviations = linear.lever * np.stack([turn, turn, np.full_like(turn, slack.shift)], axis=1)[:, None, :]
    extra = deviations @ np.swapaxes(deviations, 1, 2)
    weight = np.linalg.inv(linear.covariance + extra)
    weighed = np.swapaxes(linear.jacobian, 1, 2) @ weight
    gradient = (weighed @ linear.residual[..., None]).sum(axis=0)[:, 0]
    chi2 = np.einsum("mk,mkl,ml->m", linear.residual, weight, linear.residual)
    return (weighed @ linear.jacobian).sum(axis=0), gradient, chi2


def _slack_needed(linear: _Linear, slack: Slack) -> float:
    """The least share 0..1 of the slack under which the residuals are as large as expected."""
    freedom = 3 * len(linear.residual) - 6  # or more, where some directions are open
    low, high = 0.0, 1.0
    if freedom <= 0 or _normal_equations(linear, NO_SLACK)[2].sum() <= freedom:
        return 0.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        fits = _normal_equations(linear, slack.times(middle))[2].sum() <= freedom
        low, high = (low, middle) if fits else (middle, high)
    return high
