"""Point-to-plane steps in NumPy and SciPy, float64, with which the kernels are compared."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from sonarmap.kernels.surface.refinement import Stretching, Weighting


@dataclass
class Pose:
    """A pose during the refinement, one of the k in `Record`."""

    turn: np.ndarray
    shift: np.ndarray
    width: float
    stretch: np.ndarray


@dataclass
class Sums:
    """Sums over the pairs of points at a pose, one of the k in `Record`."""

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
    stretching: Stretching | None,
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
    by_stretch = by_stretch if stretching else np.zeros_like(by_stretch)
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


def moved(pose: Pose, sums: Sums, stretching: Stretching | None) -> Pose:
    """The pose after a joint Gauss-Newton step of itself and opposite stretches."""
    size = 6 if stretching is None else 7
    opposite = np.vstack([np.eye(7), -np.eye(7)[6]])[:, :size]
    hessian, gradient = sums.moving.copy(), sums.gradient.copy()
    if stretching is not None:
        held = stretching.known * max(pose.width, stretching.narrowest) ** stretching.power
        hessian[6:, 6:] += held * np.eye(2)
        gradient[6:] += held * pose.stretch
        gradient_apart = gradient - hessian[:, 6:] @ np.full(2, pose.stretch.mean())
    else:
        gradient_apart = gradient
    whole = opposite.T @ hessian @ opposite
    whole[:6, :6] += 1e-9 * np.trace(whole[:6, :6]) * np.eye(6)
    step = -np.linalg.lstsq(whole, gradient_apart @ opposite, rcond=1e-15)[0][:6]
    stretch = pose.stretch
    if stretching is not None:
        along = np.array([1.0, -1.0])
        rest = gradient[6:] + hessian[6:, :6] @ step
        stretch = stretch - along * (rest @ along) / (along @ hessian[6:, 6:] @ along)
    return Pose(Rotation.from_rotvec(step[:3]).as_matrix() @ pose.turn, pose.shift + step[3:], pose.width, stretch)


def squared_doubts(sums: Sums) -> tuple[np.ndarray, np.ndarray]:
    """(6,) squared doubts along the principal axes and their shares of the information, ascending."""
    information = (sums.shared + sums.shared.T)[:6, :6] / 2
    lever = np.sqrt(max(np.trace(information[:3, :3]), 1e-12) / max(sums.total, 1e-12))
    units = np.repeat([lever, 1.0], 3)
    share, axes = np.linalg.eigh(information / np.outer(units, units) / max(sums.total, 1e-12))
    axes = axes / units[:, None]
    first, second = sums.jacobians
    return ((sums.pieces[:, None] * (first @ axes) * (second @ axes)) ** 2).sum(axis=0), share
