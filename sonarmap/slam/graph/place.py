"""Initial placement of maps in the world, by instruments' priors and by control points.

The rotation by control points is that of least squares (Kabsch 1976, DOI 10.1107/S0567739476001873; Umeyama 1991,
DOI 10.1109/34.88573, without the scale) over inliers. These are the points near to the minimal subset with the smallest
median distance to all points.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import comb

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.gauge import MotionInformation
from sonarmap.slam.graph.known_pose import MeasuredPoses, known_poses
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.geometry import measured_rotation, twist
from sonarmap.spectral.scan import PosePrior

# Initial tilts beside none, rotation vectors [rad].
_TILTS = [
    angle * np.array([np.cos(toward), np.sin(toward), 0.0])
    for angle in np.deg2rad([45.0, 90.0])
    for toward in np.deg2rad([0.0, 90.0, 180.0, 270.0])
]
_TILT_SIGMA = 0.3  # standard deviation of a component's tilt before it is placed [rad]
_MAX_STEPS = 20  # of least squares
_MIN_DECREASE = 1e-3  # relative decrease of the cost below which a step is the last
_LOSS_SCALE = 2.0  # of the Cauchy loss [sigmas]
_LINE = 0.02  # second extent over the first, below which points lie on a line
_MAX_SUBSETS = 300  # minimal subsets that are tried
_INLIER = 3.0  # distance up to which a point is an inlier [median distances]


def place_in_world(
    trajectory: Trajectory, parts: Sequence[Sequence[int]], priors: Mapping[int, PosePrior]
) -> Trajectory:
    """Each component moved rigidly to where its priors place it, as an initial estimate; unmoved without priors.

    A tilt or heading that they do not determine stays as it is.

    Args:
        trajectory: N poses, each component's in a frame of its own.
        priors: instruments' measurements by pose (world East-North-Up).
    """
    poses = list(trajectory.T_world_sensor)
    for members in parts:
        known = {k: priors[k] for k in members if k in priors}
        if known:
            T_world_part = _placement(known, trajectory.T_world_sensor)
            for k in members:
                poses[k] = T_world_part * poses[k]
    return Trajectory(trajectory.stamps, RigidTransform.concatenate(poses))


def _placement(known: Mapping[int, PosePrior], T_part: RigidTransform) -> RigidTransform:
    """T_world_part by robust least squares over rigid motions, started from tilt, then heading, then position.

    Depths and positions determine the tilt too, unless poses lie on a line; where no attitude was measured, several
    tilts are tried as starts. Small tilts are preferred, which matters only where the gauge holds the tilt.
    """
    measured, tilts = MeasuredPoses.of(known), [_tilt(known, T_part)]
    if level := not any(prior.knows_attitude for prior in known.values()):
        tilts += [Rotation.from_rotvec(tilt) for tilt in _TILTS]
    starts = [_placed(known, T_part, tilt) for tilt in tilts]
    T = T_part[measured.poses]
    typical = min(float(np.median(np.abs(_residuals(measured, T, start, level)[0]))) for start in starts)
    fits = [_fitted(measured, T, start, _LOSS_SCALE * max(1.0, typical), level) for start in starts]
    return _fitted(measured, T, min(fits, key=lambda fit: fit[1])[0], _LOSS_SCALE, level)[0]


def _fitted(
    measured: MeasuredPoses, T_part_pose: RigidTransform, T_world_part: RigidTransform, scale: float, level: bool
) -> tuple[RigidTransform, float]:
    """T_world_part by Levenberg-Marquardt from a start, with a Cauchy loss of `scale`, and its cost. `level` adds a
    prior of no tilt."""
    residuals, jacobian, about = _residuals(measured, T_part_pose, T_world_part, level)
    cost, damping = _cost(residuals, scale), 1e-3
    for _ in range(_MAX_STEPS):
        weighted = jacobian / (1 + (residuals / scale) ** 2)[:, None]
        normal = weighted.T @ jacobian
        normal += np.diag(damping * np.diag(normal) + 1e-12 * np.trace(normal))
        step = np.linalg.solve(normal, -weighted.T @ residuals)
        moved = about * RigidTransform.from_components(step[3:], Rotation.from_rotvec(step[:3])) * about.inv()
        tried = _residuals(measured, T_part_pose, moved * T_world_part, level)
        damping *= 10
        if (new_cost := _cost(tried[0], scale)) < cost:
            decrease, cost, damping = cost - new_cost, new_cost, damping / 100
            (residuals, jacobian, about), T_world_part = tried, moved * T_world_part
            if decrease < _MIN_DECREASE * cost:
                break
    return T_world_part, cost


def _cost(residuals: np.ndarray, scale: float) -> float:
    return float(scale**2 * np.log1p((residuals / scale) ** 2).sum())


def _residuals(
    measured: MeasuredPoses, T_part_pose: RigidTransform, T_world_part: RigidTransform, level: bool
) -> tuple[np.ndarray, np.ndarray, RigidTransform]:
    """(m,) residuals of the measured numbers [sigmas]; their (m, 6) derivative with respect to a turn about the poses'
    middle and a shift, along the world's axes; and T_world_middle. `level` adds two residuals for the tilt."""
    T = T_world_part * T_part_pose
    about = RigidTransform.from_translation(T.translation.mean(axis=0))
    known, weights = measured.precisions > 0, np.sqrt(measured.precisions)
    residuals = (measured.residuals(T) * weights)[known]
    jacobian = (measured.jacobian(T, about.translation) * weights[:, :, None])[known]
    if level:
        up = T_world_part.rotation.apply([0.0, 0.0, 1.0])
        tilt, axis = np.arctan2(np.hypot(up[0], up[1]), up[2]) / _TILT_SIGMA, np.array([-up[1], up[0]])
        residuals = np.append(residuals, tilt * axis / max(float(np.hypot(up[0], up[1])), 1e-12))
        jacobian = np.vstack([jacobian, np.eye(2, 6) / _TILT_SIGMA])
    return residuals, jacobian, about


def _placed(known: Mapping[int, PosePrior], T_part: RigidTransform, tilt: Rotation) -> RigidTransform:
    """T_world_part with a given tilt, and with the heading and position that `known` suggests."""
    R = Rotation.from_euler("Z", _heading(known, T_part, tilt)) * tilt
    offsets = np.array(
        [prior.T_world_sensor.translation - R.apply(T_part[k].translation) for k, prior in known.items()]
    )
    measured = np.array([np.isfinite(prior.sigmas[3:]) for prior in known.values()])
    # medians, which outliers do not move
    shift = [np.median(axis[valid]) if valid.any() else 0.0 for axis, valid in zip(offsets.T, measured.T, strict=True)]
    return RigidTransform.from_components(np.array(shift), R)


def _tilt(known: Mapping[int, PosePrior], T_part: RigidTransform) -> Rotation:
    """The rotation that brings the mean of the measured verticals upright."""
    up = [
        T_part[k].rotation.apply(measured_rotation(prior).inv().apply([0.0, 0.0, 1.0]))
        for k, prior in known.items()
        if prior.knows_attitude
    ]
    if not up:
        return Rotation.identity()
    return Rotation.align_vectors([[0.0, 0.0, 1.0]], [np.mean(up, axis=0)])[0]


def _heading(known: Mapping[int, PosePrior], T_part: RigidTransform, R: Rotation) -> float:
    """The turn about the vertical after R [rad], by measured headings, else by positions."""
    turns = [
        twist(measured_rotation(prior) * (R * T_part[k].rotation).inv())
        for k, prior in known.items()
        if prior.knows_heading
    ]
    if turns:
        return float(np.angle(np.exp(1j * np.array(turns)).mean()))
    placed = [k for k, prior in known.items() if prior.knows_position]
    if len(placed) < 2:
        return 0.0
    level = np.array([1.0, 1.0, 0.0])
    there = np.stack([known[k].T_world_sensor.translation * level for k in placed])
    here = np.stack([R.apply(T_part[k].translation) * level for k in placed])
    return float(twist(robust_fit(here, there, upright=True).rotation))


def place_by_control(
    trajectory: Trajectory,
    parts: Sequence[Sequence[int]],
    control: Sequence[ControlPoint],
    priors: Mapping[int, PosePrior],
) -> Trajectory:
    """Each component moved rigidly to its control points; unmoved without any, or where instruments fully place it.

    Where attitudes are measured it turns about the vertical alone. A single point gives the translation; two points,
    or points on a line, the direction of that line, which the smallest turn brings about.

    Args:
        trajectory: N poses, each component's in a frame of its own, upright where attitudes are measured.
        control: points, of which only those of use "control" take part.
    """
    T = trajectory.T_world_sensor
    poses = T.as_matrix()
    for members in parts:
        inside = set(members)
        points = [point for point in control if point.holds and point.scan in inside]
        known = {k: priors[k] for k in members if k in priors}
        motion = MotionInformation.of(T, known_poses(known, T)).open_motion(members) if points else None
        if not points or (motion is not None and not motion.axes.size):
            continue
        here = np.stack([T[each.scan].apply(each.point) for each in points])
        there = np.stack([each.known for each in points])
        upright = any(prior.knows_attitude for prior in known.values())
        T_world_part = robust_fit(here, there, upright)
        chosen = list(members)
        poses[chosen] = (T_world_part * T[chosen]).as_matrix()
    return Trajectory(trajectory.stamps, RigidTransform.from_matrix(poses))


def robust_fit(here: np.ndarray, there: np.ndarray, upright: bool = False) -> RigidTransform:
    """T_there_here of (n, 3) points with outliers: the fit to the inliers of the best minimal subset.

    Args:
        here, there: the same points in two frames [m], n at least 1.
        upright: whether both frames have the same vertical.
    """
    size = 2 if upright else 3
    if len(here) <= size:
        return _fit(here, there, upright)
    if comb(len(here), size) > _MAX_SUBSETS:
        rng = np.random.default_rng(0)
        subsets = [rng.choice(len(here), size, replace=False) for _ in range(_MAX_SUBSETS)]
    else:
        subsets = combinations(range(len(here)), size)
    inliers, smallest = np.arange(len(here)), np.inf
    for subset in subsets:
        T = _fit(here[list(subset)], there[list(subset)], upright)
        distances = np.linalg.norm(T.apply(here) - there, axis=1)
        if (median := float(np.median(distances))) < smallest:
            inliers, smallest = np.flatnonzero(distances <= _INLIER * max(median, 1e-9)), median
    return _fit(here[inliers], there[inliers], upright)


def _fit(here: np.ndarray, there: np.ndarray, upright: bool) -> RigidTransform:
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    extents, axes = np.linalg.svd(a, full_matrices=False)[1:]
    if upright:
        up, weights = [0.0, 0.0, 1.0], [np.inf, *np.ones(len(a))]
        R_b_a = Rotation.align_vectors([up, *b], [up, *a], weights)[0]
    elif len(a) > 2 and extents[1] >= _LINE * extents[0] > 0:
        R_b_a = Rotation.align_vectors(b, a)[0]
    elif np.linalg.norm(toward := a @ axes[0] @ b) > 1e-9:
        R_b_a = Rotation.align_vectors(toward[None], axes[:1])[0]
    else:
        R_b_a = Rotation.identity()
    return RigidTransform.from_components((there - R_b_a.apply(here)).mean(axis=0), R_b_a)
