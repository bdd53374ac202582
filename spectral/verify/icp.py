"""Point-to-plane refinement of a registration, both ways, on smoothed surfaces: sub-voxel, sub-bin.

The iterative closest point of Chen and Medioni (1992, DOI 10.1016/0262-8856(92)90066-C) with the weights of Geman and
McClure, which leave out what only one scan shows. It refines a pose that the spectra found; it does not find one.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from spectral.prepare.surface import Surface
from spectral.verify.fit import Fit, principal_axes
from spectral.verify.normal_equations import NormalEquations, State
from spectral.verify.pairs import Pairs, Sample, find_pairs, medians, thin
from spectral.verify.prior_term import PriorTerm

# The width of the weights' bell: this share of how far apart points may be, or of how far the surfaces usually are.
_BELL, _WIDE_BELL = 1 / 6, 0.8
# Points as many widths of the bell apart as this no longer count.
_BELLS = 4.0
# How far surfaces usually are apart is measured where points may be at least so far apart [voxels]; nearer than that,
# rims no longer move the pose.
_MEASURED = 3.0
# Information is given as if so many points of each scan took part: `Calibration` is for these.
_FULL = 3000


@dataclass(frozen=True, slots=True)
class Start:
    """Where k refinements begin.

    Attributes:
        R: (k,) rotations.
        shifts: (k, 3) p_target = R p_source + shift about the grid centers [voxels].
        widths: (k,) how far the surfaces usually are apart, as an earlier fit has it [voxels]; 0 where that is not
            known. Where this is more than the reaches leave, points of all that the noise or the distortion moves take
            part, not of a chance layer.
    """

    R: Rotation
    shifts: np.ndarray
    widths: np.ndarray


def refine(
    target: Surface,
    source: Surface,
    begin: Start,
    reaches: tuple[float, ...],
    most: int,
    prior: PriorTerm | None = None,
    stretches: bool = False,
) -> list[Fit]:
    """Gauss-Newton from k places, at least one step, one for each reach; side by side, as if each were alone.

    Args:
        reaches: how far apart points of a pair may be, step by step [voxels].
        most: how many points of each scan are used.
        prior: what instruments measured, about the places to begin with; it counts in every step beside the planes.
        stretches: whether the ranges of each scan may be off by a share, which is estimated with the pose: a speed of
            sound that is wrong stretches all that a sensor sees away from it.
    """
    few_source, few_target = thin(source, most), thin(target, most)
    full = min(len(source.points), _FULL) + min(len(target.points), _FULL)
    scale = full / (len(few_source.points) + len(few_target.points))
    stretch = np.zeros((len(begin.shifts), 2)) if stretches else None
    state = State(begin.R.as_matrix(), begin.shifts, begin.widths, stretch, prior)
    *first, last = reaches
    for reach in first:
        state, equations, pairs = _prepare_step(target, source, few_target, few_source, state, reach, scale)
        state, _ = equations.moved(pairs, state)
    state, equations, pairs = _prepare_step(target, source, few_target, few_source, state, last, scale)
    return _finish(equations, pairs, state)


def _prepare_step(
    target: Surface,
    source: Surface,
    few_target: Sample,
    few_source: Sample,
    state: State,
    tried: float,
    scale: float,
) -> tuple[State, NormalEquations, Pairs]:
    """The pairs within reach and what they say; and how far apart they are, where that can be told."""
    bell = np.maximum(tried * _BELL, state.width * _WIDE_BELL)
    reach, is_near = np.maximum(tried, bell * _BELLS), tried < _MEASURED
    pairs = find_pairs(
        target,
        source,
        few_target,
        few_source,
        state.turn,
        state.shift,
        reach,
        stretches=state.stretch is not None,
        inner=is_near,
    )
    if not is_near:
        state = replace(state, width=medians(np.abs(pairs.gaps), pairs.near, state.width))
    return state, NormalEquations.of(pairs, state, bell, scale), pairs


def _finish(normal: NormalEquations, pairs: Pairs, state: State) -> list[Fit]:
    """The last step, and what was measured before it."""
    moved, alone = normal.moved(pairs, state)
    shared = normal.shared_information(pairs)
    information = shared[:, :6, :6]
    total = normal.weights.sum(axis=1)
    squares = (normal.weights * normal.gaps**2).sum(axis=1)
    residual = np.sqrt(squares / np.where(total > 0, total, 1.0))
    R = Rotation.from_matrix(moved.turn)
    principal = [principal_axes(*each) for each in zip(information, total.tolist(), strict=True)]
    # a turn is taken times the lever, as there
    axes = np.stack([axes / np.repeat([lever, 1.0], 3)[:, None] for _, axes, lever in principal])
    counted = np.where(total > 0, total, 1.0)[:, None]
    doubt, own = normal.shared_doubt(pairs, axes) / counted, normal.own_information(axes) / counted
    return [
        Fit(
            R=R[n],
            shift=moved.shift[n],
            information=information[n],
            residual=float(residual[n]),
            pairs=float(total[n]),
            width=float(state.width[n]),
            doubt=doubt[n],
            own=own[n],
            prior=None if state.prior is None else state.prior.of(n),
            step=alone[n],
            stretch=None if moved.stretch is None else moved.stretch[n],
            stretching=None if moved.stretch is None else shared[n, 6:],
        )
        for n in range(len(total))
    ]
