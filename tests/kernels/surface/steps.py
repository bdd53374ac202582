"""Point-to-plane steps in NumPy and SciPy, float64, with which the kernels are compared."""

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import eigh
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from sonarmap.kernels.surface.refinement import Noise, Weighting


@dataclass
class Pose:
    """A pose during the refinement, as in RECORD."""

    turn: np.ndarray
    shift: np.ndarray
    width: float
    stretch: np.ndarray
    off: np.ndarray = field(default_factory=lambda: np.zeros(6))  # residuals of instruments


@dataclass
class Sums:
    """Sums over the pairs of points at a pose, as in RECORD."""

    moving: np.ndarray
    whole: np.ndarray
    shared: np.ndarray
    gradient: np.ndarray
    total: float
    squares: float
    pieces: np.ndarray
    jacobians: tuple[np.ndarray, np.ndarray]


def sums_of(
    surfaces: list[np.ndarray],
    most: int,
    pose: Pose,
    reach: float,
    weighting: Weighting,
    stretches: bool,
) -> Sums:
    """Sums of a step between target and source, rows (m, 12); sets the pose's width in steps that measure it."""
    target, source = surfaces
    bell = max(reach * weighting.bell, pose.width * weighting.wide_bell)
    near_step, far = reach < weighting.measured, max(reach, weighting.bells * bell)
    R, t = pose.turn, pose.shift
    few_target, few_source = (rows[:: max(1, -(-len(rows) // most))] for rows in (target, source))
    distance, there = KDTree(target[:, :3]).query(few_source[:, :3] @ R.T + t)
    back_distance, here = KDTree(source[:, :3]).query((few_target[:, :3] - t) @ R)
    ours = np.vstack([few_source, source[here]])  # points of the source
    theirs = np.vstack([target[there], few_target])
    near = np.concatenate([distance, back_distance]) <= far
    inner = np.concatenate([target[there, 3], source[here, 3]]) > 0
    count = len(few_source)
    arms, turned, rays = (ours[:, k : k + 3] @ R.T for k in (0, 4, 8))
    normals = np.where(np.arange(len(ours))[:, None] < count, theirs[:, 4:7], turned)
    others = np.where(np.arange(len(ours))[:, None] < count, turned, theirs[:, 4:7])
    gaps = ((arms + t - theirs[:, :3]) * normals).sum(axis=1)
    by_stretch = np.column_stack([(rays * normals).sum(axis=1), -(theirs[:, 8:11] * normals).sum(axis=1)])
    if near_step:
        moves = near & inner & (by_stretch.prod(axis=1) <= 0)
    else:
        moves = near
        pose.width = float(np.median(np.abs(gaps[near]))) if near.any() else pose.width
    by_stretch = by_stretch if stretches else np.zeros_like(by_stretch)
    gaps = gaps + by_stretch @ pose.stretch
    weights = np.where(near, weighting.scale / (1 + (gaps / bell) ** 2) ** 2, 0.0)
    moving = np.where(moves, weights, 0.0)
    others = others * np.sign((normals * others).sum(axis=1))[:, None]
    first = np.hstack([np.cross(arms, normals), normals, by_stretch])
    second = np.hstack([np.cross(arms, others), others, by_stretch])
    return Sums(
        moving=(first * moving[:, None]).T @ first,
        whole=(first * weights[:, None]).T @ first,
        shared=(first * weights[:, None]).T @ second,
        gradient=(moving * gaps) @ first,
        total=weights.sum(),
        squares=(weights * gaps**2).sum(),
        pieces=weights,
        jacobians=(first[:, :6], second[:, :6]),
    )


def moved(pose: Pose, sums: Sums, noise: Noise, stretches: bool, term: np.ndarray | None = None) -> Pose:
    """The pose after a joint Gauss-Newton step of itself and opposite stretches; or, with the TERM of
    instruments, of itself, with the step by the pairs alone weighted against them, and of free stretches."""
    hessian, gradient = sums.moving.copy(), sums.gradient.copy()
    variance = noise.scale * max(pose.width, noise.narrowest) ** noise.power
    held = variance / noise.stretched if stretches else 0.0
    hessian[6:, 6:] += held * np.eye(2)
    gradient[6:] += held * pose.stretch
    step = _step_alone(hessian, gradient, pose, stretches)
    off = pose.off
    if term is not None:
        added = np.diag([0.0] * 6 + [held] * 2)
        whole, shared = (_of_pose((sum_ + sum_.T) / 2 + added, stretches) for sum_ in (sums.whole, sums.shared))
        step = posterior_step(step, usual_covariance(whole, shared, variance, noise.usual), off, term)
        off = off + term["jacobian"] @ step
    stretch = pose.stretch
    if stretches:
        free = np.eye(2) if term is not None else np.array([[1.0], [-1.0]])
        rest = (gradient[6:] + hessian[6:, :6] @ step) @ free
        stretch = stretch - free @ np.linalg.solve(free.T @ hessian[6:, 6:] @ free, rest)
    turn = Rotation.from_rotvec(step[:3]).as_matrix() @ pose.turn
    return Pose(turn, pose.shift + step[3:], pose.width, stretch, off)


def _step_alone(hessian: np.ndarray, gradient: np.ndarray, pose: Pose, stretches: bool) -> np.ndarray:
    """(6,) step by the pairs alone, with opposite stretches eliminated by solving for all."""
    opposite = np.vstack([np.eye(7), -np.eye(7)[6]])[:, : 6 + stretches]
    if stretches:
        gradient = gradient - hessian[:, 6:] @ np.full(2, pose.stretch.mean())
    whole = opposite.T @ hessian @ opposite
    whole[:6, :6] += 1e-9 * np.trace(whole[:6, :6]) * np.eye(6)
    return -np.linalg.lstsq(whole, gradient @ opposite, rcond=1e-15)[0][:6]


def _of_pose(hessian: np.ndarray, stretches: bool) -> np.ndarray:
    """The Schur complement of the stretches."""
    across = hessian[6:, :6]
    return hessian[:6, :6] - (across.T @ np.linalg.solve(hessian[6:, 6:], across) if stretches else 0.0)


def usual_covariance(hessian: np.ndarray, shared: np.ndarray, variance: float, usual: float) -> np.ndarray:
    """Covariance (6, 6) of the pose by the planes of a Hessian, without rare large errors; larger along directions in
    which both scans share less than 0.3 of the information."""
    damped = hessian + 1e-9 * (np.trace(hessian) + 1e-9) * np.eye(6)
    share, axes = (np.array(part, np.float64) for part in eigh(shared, damped))
    return (axes * (variance * np.clip(usual * 0.3 / np.maximum(share, 1e-9), usual, 1.0))) @ axes.T


def posterior_step(step: np.ndarray, covariance: np.ndarray, off: np.ndarray, term: np.ndarray) -> np.ndarray:
    """(6,) step by scans and instruments, from that by the scans alone and its covariance by independent errors."""
    jacobian, scans = term["jacobian"], covariance + term["systematic"]
    there, (full, none) = off + jacobian @ step, term["limits"]
    squared = there @ np.linalg.solve(jacobian @ scans @ jacobian.T + np.eye(6), there)
    factor = max(squared - full, 0.0) / max(none - squared, none / 1e6)
    along = term["shortest"] @ there
    information = np.linalg.inv(scans + factor / max(squared, full) * np.outer(along, along))
    return np.linalg.solve(information + jacobian.T @ jacobian, information @ step - jacobian.T @ off)


def squared_doubts(sums: Sums) -> tuple[np.ndarray, np.ndarray]:
    """(6,) squared doubts along the principal axes and their shares of the information, ascending."""
    information = (sums.shared + sums.shared.T)[:6, :6] / 2
    lever = np.sqrt(max(np.trace(information[:3, :3]), 1e-12) / max(sums.total, 1e-12))
    units = np.repeat([lever, 1.0], 3)
    share, axes = np.linalg.eigh(information / np.outer(units, units) / max(sums.total, 1e-12))
    axes = axes / units[:, None]
    first, second = sums.jacobians
    return ((sums.pieces[:, None] * (first @ axes) * (second @ axes)) ** 2).sum(axis=0), share
