"""Point-to-plane refinement of a registration, both ways, on smoothed surfaces: sub-voxel, sub-bin.

The iterative closest point of Chen and Medioni (1992, DOI 10.1016/0262-8856(92)90066-C) with the weights of Geman and
McClure, which leave out what only one scan shows. It refines a pose that the spectra found; it does not find one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.points.poses import upload_poses
from sonarmap.kernels.surface.record import Record
from sonarmap.kernels.surface.refinement import LastStep, Refinement, Stretching, Weighting
from sonarmap.spectral.prepare.surface import Surface
from sonarmap.spectral.verify.calibration import CALIBRATION
from sonarmap.spectral.verify.fit import Fit, shares_along
from sonarmap.spectral.verify.normal_equations import NormalEquations, State
from sonarmap.spectral.verify.prior_term import PriorTerm

# How far surfaces usually are apart is measured where points may be at least 3 voxels apart. Nearer than that, rims no
# longer move the pose: they would draw the rims of what both scans saw together, and these move with the sensor (Turk
# and Levoy, DOI 10.1145/192161.192241).
_WEIGHTING = Weighting(bell=1 / 6, wide_bell=0.8, bells=4.0, measured=3.0)
# The noise of both scans' normals is alike by so much where a sensor sees the same from nearly the same place, as it
# follows the pattern of the beams. Along a ship's side, which holds nothing, products keep up to an eighth of what this
# noise seems to hold; along bows and beds that do hold a pose they are a fifth and more.
_ALIKE = 0.06
# Information is given as if so many points of each scan took part: `Calibration` is for these.
_FULL = 3000


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

    The device takes all steps without a read. Only a prior, what instruments measured about the places to begin with,
    makes each step's sums come back, and counts in it beside the planes: with one, or stretches, in a single stage.
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
    """By at most so many points of each scan."""
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
