"""Point-to-plane refinement of a registration, both ways, on smoothed surfaces: sub-voxel, sub-bin.

The iterative closest point of Chen and Medioni (1992, DOI 10.1016/0262-8856(92)90066-C) with the weights of Geman and
McClure, which leave out what only one scan shows. It refines a pose that the spectra found; it does not find one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import upload_poses
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.surface.refinement import LastStep, Record, Refinement, Stretching, Weighting
from sonarmap.spectral.prepare.surface import Surface
from sonarmap.spectral.verify.fit import CALIBRATION, Fit, PriorTerm, posterior_step, shares_along

_OPPOSITE = np.vstack([np.eye(7), -np.eye(7)[6]])  # (8, 7) of a pose and both stretches, which are opposite
_AGREEING = 0.3  # share of one scan's information from which on that of both scans' normals is not of noise


@dataclass(frozen=True, slots=True)
class State:
    """Where k refinements are: rotations (k, 3, 3), shifts (k, 3), widths (k,), stretches (k, 2); and priors there."""

    turn: np.ndarray
    shift: np.ndarray
    width: np.ndarray
    stretch: np.ndarray | None
    prior: PriorTerm | None


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """Those of one Gauss-Newton step on the distances along the normals, of k poses; the stretches come last."""

    # hessian, gradient: (k, 6 or 8, 6 or 8) and (k, 6 or 8) by the pairs that move the pose, with what is known of the
    # stretches before
    hessian: np.ndarray
    gradient: np.ndarray
    whole: np.ndarray  # (k, 6 or 8, 6 or 8) the Hessian by all pairs, those that move it or not, with the same
    # (k, 6 or 8, 6 or 8) the Hessian from one scan's normals times the other's, without it. Normals of noisy points
    # point everywhere a little, and the sum of their squares finds information along a plane that has none. The noise
    # of two scans is independent: in products of both it averages out.
    shared: np.ndarray
    variance: np.ndarray  # (k,) of the gaps, as far as they are independent [voxels^2]

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
        """Where the step leads, and (k, 6) where it would by the scans alone."""
        step = alone = self._step_alone(state)
        if state.prior is not None:
            step = posterior_step(alone, self._usual_covariance(), state.prior)
        moved = State(
            turn=Rotation.from_rotvec(step[:, :3]).as_matrix() @ state.turn,
            shift=state.shift + step[:, 3:],
            width=state.width,
            stretch=None if state.stretch is None else self._stretched(state.stretch, step, state.prior is not None),
            prior=None if state.prior is None else state.prior.moved(step),
        )
        return moved, alone

    def _usual_covariance(self) -> np.ndarray:
        """(k, 6, 6) of where the planes of all pairs have the pose, those that move it or not."""
        shared = self.shared.copy()
        if shared.shape[1] == 8:
            shared[:, 6:, 6:] += _known_stretch(self.variance)
        return usual_covariance(_damped(_of_pose(self.whole)), _of_pose(shared), self.variance)

    def _step_alone(self, state: State) -> np.ndarray:
        """(k, 6) of the pose, where both scans are stretched by opposite shares: what both stretches have in common
        must not be sought where gaps are smallest, as scans that shrink have smaller gaps."""
        hessian, gradient = self.hessian, self.gradient
        if state.stretch is not None:
            common = state.stretch.mean(axis=1)[:, None, None] * np.ones((2, 1))
            gradient = gradient - (hessian[:, :, 6:] @ common)[:, :, 0]
            hessian, gradient = _OPPOSITE.T @ hessian @ _OPPOSITE, gradient @ _OPPOSITE
        across, stretch = hessian[:, 6:, :6], hessian[:, 6:, 6:]
        rest = across.transpose(0, 2, 1) @ np.linalg.solve(stretch, gradient[:, 6:, None])
        return -np.linalg.solve(_damped(_of_pose(hessian)), gradient[:, :6, None] - rest)[:, :, 0]

    def _stretched(self, stretch: np.ndarray, step: np.ndarray, measured: bool) -> np.ndarray:
        """(k, 2) the stretches after a step of the pose; opposite ones unless something else `measured` the pose."""
        free = np.eye(2) if measured else _OPPOSITE[6:, 6:]
        rest = self.gradient[:, 6:] + (self.hessian[:, 6:, :6] @ step[:, :, None])[:, :, 0]
        change = np.linalg.solve(free.T @ self.hessian[:, 6:, 6:] @ free, (rest @ free)[:, :, None])
        return stretch - (free @ change)[:, :, 0]


def _known_stretch(variance: np.ndarray) -> np.ndarray:
    """(k, 2, 2) what is known of both scans' stretches before, where gaps have the (k,) variances."""
    return (variance / CALIBRATION.stretched**2)[:, None, None] * np.eye(2)


def _of_pose(hessian: np.ndarray) -> np.ndarray:
    """(k, 6, 6) of the pose, whatever the stretches are: the Schur complement."""
    pose, across, stretch = hessian[:, :6, :6], hessian[:, 6:, :6], hessian[:, 6:, 6:]
    return pose - across.transpose(0, 2, 1) @ np.linalg.solve(stretch, across)


def _damped(hessian: np.ndarray) -> np.ndarray:
    """(k, 6, 6) so that what nothing fixes stays where it is."""
    damping = 1e-9 * (np.trace(hessian, axis1=1, axis2=2) + 1e-9)
    return hessian + damping[:, None, None] * np.eye(6)


def usual_covariance(hessian: np.ndarray, shared: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """(k, 6, 6) of where the planes have the pose, as errors usually are: in directions that noise alone seems to fix
    the scans are worth a tenth as much. Arguments as of `NormalEquations`."""
    inverse = np.linalg.inv(np.linalg.cholesky(hessian))
    share, axes = np.linalg.eigh(inverse @ shared @ inverse.transpose(0, 2, 1))
    doubt = np.clip(CALIBRATION.usual * _AGREEING / np.maximum(share, 1e-9), CALIBRATION.usual, 1.0)
    root = inverse.transpose(0, 2, 1) @ axes
    return (root * (variance[:, None] * doubt)[:, None, :]) @ root.transpose(0, 2, 1)


# How far surfaces usually are apart is measured where points may be at least 3 voxels apart. Nearer than that, rims no
# longer move the pose: they would draw the rims of what both scans saw together, and these move with the sensor (Turk
# and Levoy, DOI 10.1145/192161.192241).
_WEIGHTING = Weighting(bell=1 / 6, wide_bell=0.8, bells=4.0, measured=3.0)
# Share of the noise of both scans' normals that is the same where a sensor sees the same from nearly the same place, as
# it follows the pattern of the beams.
_ALIKE = 0.06
_FULL = 3000  # points of each scan that information and `Calibration` are for


@dataclass(frozen=True, slots=True)
class Start:
    R: Rotation  # (k,) rotations
    shifts: np.ndarray  # (k, 3) p_target = R p_source + shift about the grid centers [voxels]
    # (k,) how far the surfaces usually are apart, as an earlier fit has it [voxels]; 0 where that is not known. Where
    # this is more than the reaches leave, points of all that the noise or the distortion moves take part, not of a
    # chance layer.
    widths: np.ndarray
    # whether the ranges of each scan may be off by a share, which is estimated with the pose: a speed of sound that is
    # wrong stretches all that a sensor sees away from it
    stretches: bool = False


@dataclass(frozen=True, slots=True)
class Stage:
    reaches: tuple[float, ...]  # of each step, at least one, how far apart points of a pair may be [voxels]
    points: int  # how many points of each scan are used


class Refined:
    """Refinements from k places, on their way to the host; `poses`, where they lead, are as `upload_poses` has them."""

    def __init__(self, device: Device, last: LastStep, prior: PriorTerm | None, stretches: bool) -> None:
        """What `refine` has queued; what instruments say of the last step is said on the host, and at once."""
        self.poses, self._last, self._stretches = last.poses, last, stretches
        self._fits: list[Fit] | None = None
        if prior is not None:
            self._fits = _fits(last.read(), prior, stretches)
            turns, shifts = Rotation.concatenate([fit.R for fit in self._fits]), [fit.shift for fit in self._fits]
            self.poses = upload_poses(device, turns.as_matrix(), np.array(shifts))

    def read(self) -> list[Fit]:
        """Where they lead, and what the surfaces say there."""
        return _fits(self._last.read(), None, self._stretches) if self._fits is None else self._fits


def refine(
    device: Device,
    target: Surface,
    source: Surface,
    begin: Start,
    stages: Sequence[Stage],
    prior: PriorTerm | None = None,
) -> Refined:
    """Queue Gauss-Newton from k places, side by side, as if each were alone; stage by stage, from coarse to fine.

    The device takes all steps without a read, but with a prior, which counts beside the planes in each step: then, or
    with stretches, in a single stage.
    """
    *before, last = stages
    stretches = begin.stretches
    stretch = np.zeros((len(begin.shifts), 2)) if stretches else None
    steps = _refinement(device, target, source, stages[0].points, stretches)
    steps.begin(begin.R.as_matrix(), begin.shifts, begin.widths, stretch)
    for stage, following in zip(before, stages[1:], strict=True):
        for reach in stage.reaches:
            steps.step(reach, alone=True)
        ended, steps = steps, _refinement(device, target, source, following.points, stretches)
        steps.begin_after(ended)
    for reach in last.reaches[:-1]:
        steps.step(reach, alone=prior is None)
        if prior is not None:
            state, equations = _equations(steps.end().read(), prior, stretches)
            state, _ = equations.moved(state)
            prior = state.prior
            steps.begin(state.turn, state.shift, state.width, state.stretch)
    steps.step(last.reaches[-1], alone=False)
    return Refined(device, steps.end(), prior, stretches)


def _refinement(device: Device, target: Surface, source: Surface, most: int, stretches: bool) -> Refinement:
    """By `most` points of each scan at most."""
    elements = target.elements, source.elements
    scale = sum(min(len(each), _FULL) for each in elements) / sum(each.thinned(most)[0] for each in elements)
    stretching = None
    if stretches:
        known = float(CALIBRATION.variance(np.array(1.0))) / CALIBRATION.stretched**2
        stretching = Stretching(known, CALIBRATION.width, CALIBRATION.narrowest)
    return Refinement(device, *elements, most, replace(_WEIGHTING, scale=scale), stretching)


def _equations(record: Record, prior: PriorTerm | None, stretches: bool) -> tuple[State, NormalEquations]:
    """Where the poses are and what the pairs there say."""
    state = State(record.turn, record.shift, record.width, record.stretch if stretches else None, prior)
    return state, NormalEquations.of(record, state)


def _fits(record: Record, prior: PriorTerm | None, stretches: bool) -> list[Fit]:
    """Where the last step leads, and what was measured before it."""
    state, normal = _equations(record, prior, stretches)
    if prior is None:
        stretch = record.next_stretch if stretches else None
        moved = State(record.next_turn, record.next_shift, record.width, stretch, None)
        alone = np.zeros((len(record.total), 6))
    else:
        moved, alone = normal.moved(state)
    shared = normal.shared
    information, total = shared[:, :6, :6], record.total
    counted = np.where(total > 0, total, 1.0)
    R, residual = Rotation.from_matrix(moved.turn), np.sqrt(record.squares / counted)
    noise = shares_along(normal.whole[:, :6, :6] - information, information, counted)
    doubt = np.hypot(np.sqrt(record.doubts) / counted[:, None], _ALIKE * noise)
    return [
        Fit(
            R=R[n],
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
