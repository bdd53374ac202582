"""Symmetric point-to-plane refinement of poses on smoothed surfaces, to a fraction of a voxel and of a bin.

The iterative closest point of Chen and Medioni (1992, DOI 10.1016/0262-8856(92)90066-C) with the weights of Geman and
McClure, which suppress surfaces that only one scan shows. It needs a start near the true pose.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.surface.refinement import Noise, Refinement, Weighting
from sonarmap.spectral.prepare.surface import Surface
from sonarmap.spectral.verify.fit import CALIBRATION, Fit, PriorTerm

# The width is measured at reaches of at least 3 voxels. At smaller reaches rims do not move the pose: they would draw
# the rims of both views together, which move with the sensor (Turk and Levoy, DOI 10.1145/192161.192241).
_WEIGHTING = Weighting(bell=1 / 6, wide_bell=0.8, bells=4.0, measured=3.0)
# Correlation of the noise of both scans' normals if they are seen from nearly the same place, as the noise follows the
# pattern of the beams.
_ALIKE = 0.06
_NOISE = Noise(
    scale=float(CALIBRATION.variance(np.array(1.0))),
    power=CALIBRATION.width,
    narrowest=CALIBRATION.narrowest,
    stretched=CALIBRATION.stretched**2,
    usual=CALIBRATION.usual,
)
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


PriorAt = Callable[[Rotation, np.ndarray, bool], PriorTerm]  # as `PairFrames.prior_at`


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
    prior_at: PriorAt | None = None,
) -> Refined:
    """Queue Gauss-Newton refinements of k poses, independent of each other; stage by stage, from coarse to fine.

    The device takes all steps without a read, but waits after each stage if there is a prior: it is linearized about
    the pose at each stage (`PairFrames.prior_at`). With stretches there must be a single stage.
    """
    steps = _refinement(device, target, source, stages[0].points, begin.stretches)
    prior = _begin(steps, begin, prior_at)
    for stage, following in pairwise(stages):
        for reach in stage.reaches:
            steps.step(reach)
        ended, steps = steps, _refinement(device, target, source, following.points, begin.stretches)
        if prior is None:
            steps.begin_after(ended)
        else:
            at = ended.read().read()
            prior = _begin(steps, Start(Rotation.from_matrix(at["turn"]), at["shift"], at["width"]), prior_at)
    for reach in stages[-1].reaches[:-1]:
        steps.step(reach)
    steps.step(stages[-1].reaches[-1], moves=False)
    poses, records = steps.end()
    return Refined(poses, lambda: _fits(records.read(), prior, begin.stretches))


def _begin(steps: Refinement, start: Start, prior_at: PriorAt | None) -> PriorTerm | None:
    """Set the poses before the first step, and return the prior linearized about them."""
    prior = None if prior_at is None else prior_at(start.R, start.shifts, start.stretches)
    terms = None if prior is None else prior.for_device()
    steps.begin(start.R.as_matrix(), start.shifts, start.widths, terms=terms)
    return prior


def start_of(fits: Sequence[Fit], stretches: bool = False) -> Start:
    """The start of a further refinement of poses."""
    R = Rotation.concatenate([fit.R for fit in fits])
    return Start(R, np.array([fit.shift for fit in fits]), np.array([fit.width for fit in fits]), stretches)


def _refinement(device: Device, target: Surface, source: Surface, most: int, stretches: bool) -> Refinement:
    """The device's refinement with at most `most` points of each scan."""
    elements = target.elements, source.elements
    scale = sum(min(len(each), _FULL) for each in elements) / sum(each.thinned(most)[0] for each in elements)
    return Refinement(device, *elements, most, replace(_WEIGHTING, scale=scale), _NOISE, stretches)


def _fits(record: np.ndarray, prior: PriorTerm | None, stretches: bool) -> list[Fit]:
    """The fits after the last step, with the information measured before it, from (k,) RECORD."""
    total = record["total"]
    # products of one scan's normals with the other's: squares of noisy normals give false information along a plane; in
    # these the noise of the two scans, which is independent, averages out
    shared = (record["shared"] + record["shared"].mT) / 2
    information = shared[:, :6, :6]
    counted = np.where(total > 0, total, 1.0)
    residual = np.sqrt(record["squares"] / counted)
    axes, doubts = record["axes"], np.sqrt(record["doubts"][:, :6]) / counted[:, None]
    doubt = np.hypot(doubts, _ALIKE * axes[:, :, 7])
    R, prior = Rotation.from_matrix(record["next_turn"]), None if prior is None else prior.after(record["off"])
    return [
        Fit(
            R=R[n],
            shift=record["next_shift"][n],
            information=information[n],
            residual=float(residual[n]),
            pairs=float(total[n]),
            width=float(record["width"][n]),
            shares=axes[n, :, 6],
            doubt=doubt[n],
            prior=None if prior is None else prior.of(n),
            step=np.zeros(6) if prior is None else record["alone"][n],
            stretch=record["next_stretch"][n] if stretches else None,
            stretching=shared[n, 6:] if stretches else None,
        )
        for n in range(len(total))
    ]
