"""Where a map lies in the world, as a start for an optimizer: by what instruments say, and by control points.

By control points the rotation is the one of least squares (Kabsch 1976, DOI 10.1107/S0567739476001873; Umeyama 1991,
DOI 10.1109/34.88573, without the scale), whatever one wrong point says: the fewest points that tell it are tried in all
choices, and the choice is taken that the points on the whole are nearest to.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from math import comb

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.gauge import MotionInformation
from sonarmap.slam.graph.known_pose import MeasuredPoses
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.geometry import measured_rotation, twist
from sonarmap.spectral.scan import PosePrior

# Tilts to begin with beside none, rotation vectors [rad].
_TILTS = [
    angle * np.array([np.cos(toward), np.sin(toward), 0.0])
    for angle in np.deg2rad([45.0, 90.0])
    for toward in np.deg2rad([0.0, 90.0, 180.0, 270.0])
]
_LEVEL = 0.3  # how far a part's own tilt usually is from the world's, standard deviation [rad]
_MOST_STEPS = 20  # of least squares
_SMALL_FALL = 1e-3  # of chi-squared in a step, as a share, which ends them
_FAR_SIGMAS = 2.0  # residuals beyond it count ever less
_LINE = 0.02  # second extent over the first, below which points lie on a line
_CHOICES = 300  # of the fewest points that determine a pose, at most
_INLIER = 3.0  # median distances within which points take part in the final fit

_Fit = Callable[[np.ndarray, np.ndarray], RigidTransform]


def place_in_world(
    trajectory: Trajectory, parts: Sequence[Sequence[int]], priors: Mapping[int, PosePrior]
) -> Trajectory:
    """Each part moved as a whole to where its priors say, as a start for an optimizer; unmoved without priors.

    What they do not say stays as it is: the part's tilt, as its first sensor's, and its heading.

    Args:
        trajectory: N poses, each part's in a frame of its own.
        priors: what instruments measured, by pose (world East-North-Up).
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
    """T_world_part: the robust least squares of a motion of the part as a whole, from where tilt, then heading, then
    position lead.

    Depths and positions tell the tilt too, where the part is not on a line: where nobody measured it, several tilts are
    the beginning. Small ones are more likely, which matters only where the gauge holds what comes of it.
    """
    measured, tilts = MeasuredPoses.of(known), [_tilt(known, T_part)]
    if level := not any(prior.knows_attitude for prior in known.values()):
        tilts += [Rotation.from_rotvec(tilt) for tilt in _TILTS]
    starts = [_placed(known, T_part, tilt) for tilt in tilts]
    T = T_part[measured.poses]
    usual = min(float(np.median(np.abs(_off(measured, T, start, level)[0]))) for start in starts)
    fits = [_fitted(measured, T, start, _FAR_SIGMAS * max(1.0, usual), level) for start in starts]
    return _fitted(measured, T, min(fits, key=lambda fit: fit[1])[0], _FAR_SIGMAS, level)[0]


def _fitted(
    measured: MeasuredPoses, T_part_pose: RigidTransform, T_world_part: RigidTransform, scale: float, level: bool
) -> tuple[RigidTransform, float]:
    """T_world_part by robust least squares from a start, and chi-squared; residuals beyond `scale` count ever less.
    With `level` it is tilted as little as the rest allows."""
    residuals, jacobian, about = _off(measured, T_part_pose, T_world_part, level)
    cost, damping = _cost(residuals, scale), 1e-3
    for _ in range(_MOST_STEPS):
        weighed = jacobian / (1 + (residuals / scale) ** 2)[:, None]
        total = weighed.T @ jacobian
        total += np.diag(damping * np.diag(total) + 1e-12 * np.trace(total))
        step = np.linalg.solve(total, -weighed.T @ residuals)
        moved = about * RigidTransform.from_components(step[3:], Rotation.from_rotvec(step[:3])) * about.inv()
        tried = _off(measured, T_part_pose, moved * T_world_part, level)
        damping *= 10
        if (less := _cost(tried[0], scale)) < cost:
            fallen, cost, damping = cost - less, less, damping / 100
            (residuals, jacobian, about), T_world_part = tried, moved * T_world_part
            if fallen < _SMALL_FALL * cost:
                break
    return T_world_part, cost


def _cost(residuals: np.ndarray, scale: float) -> float:
    return float(scale**2 * np.log1p((residuals / scale) ** 2).sum())


def _off(
    measured: MeasuredPoses, T_part_pose: RigidTransform, T_world_part: RigidTransform, level: bool
) -> tuple[np.ndarray, np.ndarray, RigidTransform]:
    """How far poses are from each of m numbers that were measured, (m,) [sigmas]; (m, 6) by how much more with a turn
    about their middle and a shift, along the world's axes; and T_world_middle. `level` counts the part's tilt too."""
    T = T_world_part * T_part_pose
    about = RigidTransform.from_translation(T.translation.mean(axis=0))
    known, weights = measured.precisions > 0, np.sqrt(measured.precisions)
    residuals = (measured.residuals(T) * weights)[known]
    jacobian = (measured.jacobian(T, about.translation) * weights[:, :, None])[known]
    if level:
        up = T_world_part.rotation.apply([0.0, 0.0, 1.0])
        away, aside = np.arctan2(np.hypot(up[0], up[1]), up[2]) / _LEVEL, np.array([-up[1], up[0]])
        residuals = np.append(residuals, away * aside / max(float(np.hypot(up[0], up[1])), 1e-12))
        jacobian = np.vstack([jacobian, np.eye(2, 6) / _LEVEL])
    return residuals, jacobian, about


def _placed(known: Mapping[int, PosePrior], T_part: RigidTransform, tilt: Rotation) -> RigidTransform:
    """T_world_part with a tilt."""
    R = Rotation.from_euler("Z", _heading(known, T_part, tilt)) * tilt
    offsets = np.array(
        [prior.T_world_sensor.translation - R.apply(T_part[k].translation) for k, prior in known.items()]
    )
    measured = np.array([np.isfinite(prior.sigmas[3:]) for prior in known.values()])
    # the middle one: a few that are far off move nothing
    middle = [np.median(own[told]) if told.any() else 0.0 for own, told in zip(offsets.T, measured.T, strict=True)]
    return RigidTransform.from_components(np.array(middle), R)


def _tilt(known: Mapping[int, PosePrior], T_part: RigidTransform) -> Rotation:
    """A rotation that brings the parts' verticals upright, on the whole."""
    up = [
        T_part[k].rotation.apply(measured_rotation(prior).inv().apply([0.0, 0.0, 1.0]))
        for k, prior in known.items()
        if prior.knows_attitude
    ]
    if not up:
        return Rotation.identity()
    return Rotation.align_vectors([[0.0, 0.0, 1.0]], [np.mean(up, axis=0)])[0]


def _heading(known: Mapping[int, PosePrior], T_part: RigidTransform, R: Rotation) -> float:
    """The turn about the vertical that is left [rad]: by the headings, else by positions."""
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
    """Each part moved as a whole to where its control points are, as far as they tell; unmoved without, or where
    instruments tell all.

    Where attitudes are measured the part is turned about the vertical alone. A single point tells the place; two, or
    points on a line, how the line lies, and the turn is the smallest that brings it there.

    Args:
        trajectory: N poses, each part's in a frame of its own, upright where attitudes are measured.
        control: points; those that hold the map count.
    """
    poses = trajectory.T_world_sensor.as_matrix()
    for members in parts:
        inside = set(members)
        points = [point for point in control if point.holds and point.scan in inside]
        known = {k: priors[k] for k in members if k in priors}
        motion = MotionInformation.of(trajectory.T_world_sensor, known).open_motion(members) if points else None
        if not points or (motion is not None and not motion.axes.size):
            continue
        here = np.stack([trajectory.T_world_sensor[each.scan].apply(each.point) for each in points])
        there = np.stack([each.known for each in points])
        upright = any(prior.knows_attitude for prior in known.values())
        T_world_part = robust_fit(here, there, upright)
        chosen = list(members)
        poses[chosen] = (T_world_part * trajectory.T_world_sensor[chosen]).as_matrix()
    return Trajectory(trajectory.stamps, RigidTransform.from_matrix(poses))


def robust_fit(here: np.ndarray, there: np.ndarray, upright: bool = False) -> RigidTransform:
    """T_there_here of (n, 3) points, most of which are right: the fit of those that the best few are near to.

    Args:
        here, there: the same points in two frames [m], n at least 1.
        upright: whether both frames have the same vertical.
    """
    fit: _Fit = _fit_upright if upright else _fit
    few = 2 if upright else 3
    if len(here) <= few:
        return fit(here, there)
    if comb(len(here), few) > _CHOICES:
        rng = np.random.default_rng(0)
        choices = [rng.choice(len(here), few, replace=False) for _ in range(_CHOICES)]
    else:
        choices = combinations(range(len(here)), few)
    best, usual = np.arange(len(here)), np.inf
    for choice in choices:
        T = fit(here[list(choice)], there[list(choice)])
        apart = np.linalg.norm(T.apply(here) - there, axis=1)
        if (median := float(np.median(apart))) < usual:
            best, usual = np.flatnonzero(apart <= _INLIER * max(median, 1e-9)), median
    return fit(here[best], there[best])


def _fit(here: np.ndarray, there: np.ndarray) -> RigidTransform:
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    extents, axes = np.linalg.svd(a, full_matrices=False)[1:]
    if len(a) < 2 or extents[0] < 1e-9:
        R_b_a = Rotation.identity()
    elif len(a) == 2 or extents[1] < _LINE * extents[0]:
        along = a @ axes[0]
        toward = along @ b
        length = np.linalg.norm(toward)
        R_b_a = Rotation.align_vectors(toward[None], axes[:1])[0] if length > 1e-9 else Rotation.identity()
    else:
        u, _, vt = np.linalg.svd(b.T @ a)
        R_b_a = Rotation.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)
    return _moved(R_b_a, here, there)


def _fit_upright(here: np.ndarray, there: np.ndarray) -> RigidTransform:
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    sine = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
    cosine = (a[:, :2] * b[:, :2]).sum()
    return _moved(Rotation.from_euler("Z", float(np.arctan2(sine, cosine))), here, there)


def _moved(R: Rotation, here: np.ndarray, there: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components((there - R.apply(here)).mean(axis=0), R)
