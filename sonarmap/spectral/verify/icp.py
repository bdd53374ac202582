"""Symmetric point-to-plane refinement of poses on smoothed surfaces, to a fraction of a voxel and of a bin.

The iterative closest point of Chen and Medioni (1992, DOI 10.1016/0262-8856(92)90066-C) with the weights of Geman and
McClure, which suppress surfaces that only one scan shows. It needs a start near the true pose.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import upload_poses
from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.surface.refinement import Record, Refinement, Stretching, Weighting
from sonarmap.spectral.prepare.surface import Surface
from sonarmap.spectral.verify.fit import CALIBRATION, Fit, PriorTerm, posterior_step, shares_along

_OPPOSITE = np.vstack([np.eye(7), -np.eye(7)[6]])  # (8, 7) maps pose and one stretch to pose and opposite stretches
_AGREEING = 0.3  # ratio of shared to whole information from which it is not due to noise


@dataclass(frozen=True, slots=True)
class State:
    """State of k refinements: rotations (k,), shifts (k, 3), widths (k,), stretches (k, 2), and priors."""

    R: Rotation
    shift: np.ndarray
    width: np.ndarray
    stretch: np.ndarray | None
    prior: PriorTerm | None


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """Normal equations of a Gauss-Newton step on the point-to-plane distances of k poses; the stretches come last."""

    # hessian, gradient: (k, 6 or 8, 6 or 8) and (k, 6 or 8) by the pairs that move the pose, with the prior of the
    # stretches
    hessian: np.ndarray
    gradient: np.ndarray
    whole: np.ndarray  # (k, 6 or 8, 6 or 8) Hessian by all pairs, those at rims too, with the same prior
    # (k, 6 or 8, 6 or 8) Hessian from products of one scan's normals with the other's, without the prior. Squares of
    # noisy normals give false information along a plane; in these products the noise of the two scans, which is
    # independent, averages out.
    shared: np.ndarray
    variance: np.ndarray  # (k,) of the independent part of the distances [voxels^2]

    @classmethod
    def of(cls, record: Record, state: State) -> "NormalEquations":
        size = 6 if state.stretch is None else 8
        variance = CALIBRATION.variance(state.width)
        hessian, whole, shared = (sums[:, :size, :size].copy() for sums in (record.moving, record.whole, record.shared))
        gradient = record.gradient[:, :size].copy()
        if state.stretch is not None:
            known = _known_stretch(variance)
            hessian[:, 6:, 6:] += known
            whole[:, 6:, 6:] += known
            gradient[:, 6:] += (known @ state.stretch[:, :, None])[:, :, 0]
        return cls(hessian, gradient, whole, (shared + shared.transpose(0, 2, 1)) / 2, variance)

    def moved(self, state: State) -> tuple[State, np.ndarray]:
        """The state after the step, and (k, 6) the step by the scans alone."""
        step = alone = self._step_alone(state)
        if state.prior is not None:
            step = posterior_step(alone, self._usual_covariance(), state.prior)
        moved = State(
            R=Rotation.from_rotvec(step[:, :3]) * state.R,
            shift=state.shift + step[:, 3:],
            width=state.width,
            stretch=None if state.stretch is None else self._stretched(state.stretch, step, state.prior is not None),
            prior=None if state.prior is None else state.prior.moved(step),
        )
        return moved, alone

    def _usual_covariance(self) -> np.ndarray:
        """Covariance (k, 6, 6) of the pose by the planes of all pairs, those at rims too."""
        shared = self.shared.copy()
        if shared.shape[1] == 8:
            shared[:, 6:, 6:] += _known_stretch(self.variance)
        return usual_covariance(_damped(_of_pose(self.whole)), _of_pose(shared), self.variance)

    def _step_alone(self, state: State) -> np.ndarray:
        """(k, 6) step of the pose, with the change of the stretches restricted to opposite ones: minimizing distances
        over a common stretch would shrink both scans."""
        hessian, gradient = self.hessian, self.gradient
        if state.stretch is None:
            return -np.linalg.solve(_damped(hessian), gradient[:, :, None])[:, :, 0]
        common = state.stretch.mean(axis=1)[:, None, None] * np.ones((2, 1))
        gradient = gradient - (hessian[:, :, 6:] @ common)[:, :, 0]
        hessian, gradient = _OPPOSITE.T @ hessian @ _OPPOSITE, gradient @ _OPPOSITE
        across, stretch = hessian[:, 6:, :6], hessian[:, 6:, 6:]
        rest = across.transpose(0, 2, 1) @ np.linalg.solve(stretch, gradient[:, 6:, None])
        return -np.linalg.solve(_damped(_of_pose(hessian)), gradient[:, :6, None] - rest)[:, :, 0]

    def _stretched(self, stretch: np.ndarray, step: np.ndarray, measured: bool) -> np.ndarray:
        """(k, 2) stretches after a step of the pose; they change oppositely unless instruments `measured` the pose."""
        free = np.eye(2) if measured else _OPPOSITE[6:, 6:]
        rest = self.gradient[:, 6:] + (self.hessian[:, 6:, :6] @ step[:, :, None])[:, :, 0]
        change = np.linalg.solve(free.T @ self.hessian[:, 6:, 6:] @ free, (rest @ free)[:, :, None])
        return stretch - (free @ change)[:, :, 0]


def _known_stretch(variance: np.ndarray) -> np.ndarray:
    """(k, 2, 2) prior information of both stretches, in units of the (k,) variances of the distances."""
    return (variance / CALIBRATION.stretched**2)[:, None, None] * np.eye(2)


def _of_pose(hessian: np.ndarray) -> np.ndarray:
    """(k, 6, 6) Hessian of the pose with the stretches eliminated, if there are any: the Schur complement."""
    if hessian.shape[1] == 6:
        return hessian
    pose, across, stretch = hessian[:, :6, :6], hessian[:, 6:, :6], hessian[:, 6:, 6:]
    return pose - across.transpose(0, 2, 1) @ np.linalg.solve(stretch, across)


def _damped(hessian: np.ndarray) -> np.ndarray:
    """The Hessian (k, 6, 6) with damping, so that the step is 0 in unconstrained directions."""
    damping = 1e-9 * (np.trace(hessian, axis1=1, axis2=2) + 1e-9)
    return hessian + damping[:, None, None] * np.eye(6)


def usual_covariance(hessian: np.ndarray, shared: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Covariance (k, 6, 6) of the pose by the planes, without rare large errors, but larger in directions that noise
    alone seems to constrain. For the arguments see `NormalEquations`."""
    inverse = np.linalg.inv(np.linalg.cholesky(hessian))
    share, axes = np.linalg.eigh(inverse @ shared @ inverse.transpose(0, 2, 1))
    doubt = np.clip(CALIBRATION.usual * _AGREEING / np.maximum(share, 1e-9), CALIBRATION.usual, 1.0)
    root = inverse.transpose(0, 2, 1) @ axes
    return (root * (variance[:, None] * doubt)[:, None, :]) @ root.transpose(0, 2, 1)


# The width is measured at reaches of at least 3 voxels. At smaller reaches rims do not move the pose: they would draw
# the rims of both views together, which move with the sensor (Turk and Levoy, DOI 10.1145/192161.192241).
_WEIGHTING = Weighting(bell=1 / 6, wide_bell=0.8, bells=4.0, measured=3.0)
# Correlation of the noise of both scans' normals if they are seen from nearly the same place, as the noise follows the
# pattern of the beams.
_ALIKE = 0.06
_FULL = 3000  # points of each scan that the information is scaled to, as in `Calibration`


@dataclass(frozen=True, slots=True)
class Start:
    R: Rotation  # (k,) rotations
    shifts: np.ndarray  # (k, 3) p_target = R p_source + shift about the grid centers [voxels]
    # (k,) typical distance of the surfaces by an earlier fit [voxels]; 0 if unknown. If it is large for the
    # reaches, the weights are widened to include all points that noise or distortion displaces, not a chance layer.
    widths: np.ndarray
    # whether a scale error of each scan's ranges is estimated with the pose, as a wrong speed of sound stretches the
    # scan away from the sensor
    stretches: bool = False


@dataclass(frozen=True, slots=True)
class Stage:
    reaches: tuple[float, ...]  # of each step, at least one: largest distance of paired points [voxels]
    points: int  # largest number of points of each scan


@dataclass(frozen=True, slots=True)
class Refined:
    """k refinements whose results are on the device."""

    poses: Array  # the refined ones, in the layout of `upload_poses`
    read: Callable[[], list[Fit]]  # the same with their information; waits for the device


def refine(
    device: Device,
    target: Surface,
    source: Surface,
    begin: Start,
    stages: Sequence[Stage],
    prior_at: Callable[[Rotation, np.ndarray, bool], PriorTerm] | None = None,
) -> Refined:
    """Queue Gauss-Newton refinements of k poses, independent of each other; stage by stage, from coarse to fine.

    The device takes all steps without a read, except with a prior, which is combined with the planes in each step and
    linearized at each stage (`PairFrames.prior_at`). With stretches there must be a single stage.
    """
    stretch = np.zeros((len(begin.shifts), 2)) if begin.stretches else None
    state = State(begin.R, begin.shifts, begin.widths, stretch, None)
    ended = steps = _refinement(device, target, source, stages[0].points, begin.stretches)
    for stage in stages:
        if stage is not stages[0]:
            ended, steps = steps, _refinement(device, target, source, stage.points, begin.stretches)
        if prior_at is not None:
            state = replace(state, prior=prior_at(state.R, state.shift, begin.stretches))
        if steps is ended or prior_at is not None:
            steps.begin(state.R.as_matrix(), state.shift, state.width, state.stretch)
        else:
            steps.begin_after(ended)
        for reach in stage.reaches[:-1] if stage is stages[-1] else stage.reaches:
            steps.step(reach, alone=prior_at is None)
            if prior_at is not None:
                state = _moved(steps, state)
    steps.step(stages[-1].reaches[-1], alone=False)
    last = steps.end()
    if prior_at is None:
        return Refined(last.poses, lambda: _fits(last.read(), state))
    fits = _fits(last.read(), state)
    R, shifts = Rotation.concatenate([fit.R for fit in fits]), np.array([fit.shift for fit in fits])
    return Refined(upload_poses(device, R.as_matrix(), shifts), lambda: fits)


def _moved(steps: Refinement, before: State) -> State:
    """The state after a step with a prior, for which the device is read; the next step begins there."""
    record = steps.record()
    before = replace(before, width=record.width)
    state, _ = NormalEquations.of(record, before).moved(before)
    steps.begin(state.R.as_matrix(), state.shift, state.width, state.stretch)
    return state


def _refinement(device: Device, target: Surface, source: Surface, most: int, stretches: bool) -> Refinement:
    """The device's refinement with at most `most` points of each scan."""
    elements = target.elements, source.elements
    scale = sum(min(len(each), _FULL) for each in elements) / sum(each.thinned(most)[0] for each in elements)
    stretching = None
    if stretches:
        known = float(CALIBRATION.variance(np.array(1.0))) / CALIBRATION.stretched**2
        stretching = Stretching(known, CALIBRATION.width, CALIBRATION.narrowest)
    return Refinement(device, *elements, most, replace(_WEIGHTING, scale=scale), stretching)


def _fits(record: Record, before: State) -> list[Fit]:
    """The fits after the last step, with the information measured before it. `before` is the state before that step, or
    without a prior before all steps."""
    state = replace(before, width=record.width, stretch=None if before.stretch is None else record.stretch)
    normal = NormalEquations.of(record, state)
    if state.prior is None:
        stretch = None if before.stretch is None else record.next_stretch
        moved = State(Rotation.from_matrix(record.next_turn), record.next_shift, record.width, stretch, None)
        alone = np.zeros((len(record.total), 6))
    else:
        moved, alone = normal.moved(state)
    shared = normal.shared
    information, total = shared[:, :6, :6], record.total
    counted = np.where(total > 0, total, 1.0)
    residual = np.sqrt(record.squares / counted)
    noise = shares_along(normal.whole[:, :6, :6] - information, information, counted)
    doubt = np.hypot(np.sqrt(record.doubts) / counted[:, None], _ALIKE * noise)
    return [
        Fit(
            R=moved.R[n],
            shift=moved.shift[n],
            information=information[n],
            residual=float(residual[n]),
            pairs=float(total[n]),
            width=float(state.width[n]),
            doubt=doubt[n],
            prior=None if state.prior is None else state.prior.of(n),
            step=alone[n],
            stretch=None if moved.stretch is None else moved.stretch[n],
            stretching=None if moved.stretch is None else shared[n, 6:],
        )
        for n in range(len(total))
    ]
