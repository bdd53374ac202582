"""Candidate poses, and hypotheses: refined relative poses of two scans, with their evidence."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan, log, nan

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.spectral.fitted import FITTED
from sonarmap.spectral.so3 import distinct
from sonarmap.spectral.verify.fit import Fit


@dataclass(frozen=True, slots=True)
class Candidates:
    """n candidate poses, as arrays."""

    R: Rotation  # (n,) R_target_source
    shifts: np.ndarray  # (n, 3) p_target = R p_source + shift about the grid centers [voxels]
    psr: np.ndarray  # (n,) of the translation's peak
    rotation_scores: np.ndarray  # (n,) of the rotation's peak, from `RotationPeaks`

    def select(self, selected: np.ndarray) -> "Candidates":
        return Candidates(self.R[selected], self.shifts[selected], self.psr[selected], self.rotation_scores[selected])


MOST_MEASURED = 30.0  # largest chi-squared by instruments that counts
# Exponents of the evidence in a score; those of residual and width apply to the inverse. `surface_alone` and `overlap`
# are used without a view. `measured` is small, as distorted scans contradict correct instruments.
# docs/registration.md says how they were fitted.
_POWERS: dict[str, float] = FITTED["ranking"]
# Refined poses closer than this are the same hypothesis.
_SAME_ROTATION = float(np.deg2rad(3.0))  # [rad]
SAME_REFINED_SHIFT = 2.0  # [voxels]


@dataclass(frozen=True, slots=True)
class Evidence:
    """The evidence for a pose; NaN for values not measured yet."""

    # consistency of the scans' views, 0..1, with a tight tolerance; NaN if no viewpoint is known
    view: float = nan
    coarse_view: float = nan  # the same, with a wide tolerance
    surface: float = nan  # consistency of the surfaces, 0..1, from `SharedSurface`
    overlap: float = nan  # share of points in common, 0..1, the smaller of both directions
    # weighted rms distance of the shared points to each other's planes [voxels]; with little noise it distinguishes
    # surfaces that are nearly the same
    residual: float = nan
    width: float = nan  # median distance of all points near each other's planes [voxels], `Fit.width`
    firmness: float = nan  # how firmly their planes constrain the pose, 0..1, from `firmness`
    psr: float = nan  # peak-to-sidelobe ratio of the translation at the pose, on the whole grid, phase only
    moved: float = nan  # distance from the identity, from `PairFrames.moved` [voxels]
    measured: float = 0.0  # chi-squared of the pose by the instruments; 0 without any
    # logarithm of the inverse residual, compared over beds of little relief, whose places are similar; 0 for other
    # surfaces
    closeness: float = 0.0

    @property
    def consistency(self) -> float:
        """Consistency of the views, or of the surfaces without a view, 0..1."""
        return self.surface if isnan(self.view) else self.view

    @property
    def agreement(self) -> float:
        """Logarithm of the product of all evidence but the correlation at the pose."""
        if isnan(self.view):
            seen = _POWERS["surface_alone"] * _log(self.surface) + _POWERS["overlap"] * _log(self.overlap)
        else:
            seen = _POWERS["view"] * _log(self.view) + _POWERS["coarse_view"] * _log(self.coarse_view)
            seen += _POWERS["surface"] * _log(self.surface)
        blur = _POWERS["residual"] * log(max(self.residual, 0.03)) + _POWERS["width"] * log(max(self.width, 0.03))
        held = _POWERS["firmness"] * log(max(self.firmness, 1e-4))
        return seen - blur + held - _POWERS["measured"] * min(self.measured, MOST_MEASURED) / 2

    @property
    def score(self) -> float:
        """Logarithm of the score that ranks hypotheses. The peak has a small weight: if beams are farther apart than
        voxels, the lines that they draw on a floor or a wall correlate by themselves."""
        return self.agreement + _POWERS["psr"] * _peak(self.psr) + _POWERS["closeness"] * self.closeness


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A refined pose and its evidence."""

    fit: Fit  # the pose and its information
    rotation_score: float  # of the rotation's peak that it comes from, from `RotationPeaks`
    candidate_psr: float  # peak-to-sidelobe ratio of the translation's peak that it comes from, before the refinement
    evidence: Evidence = Evidence()  # measured at the pose

    @property
    def candidate_score(self) -> float:
        """Logarithm of the score that selects the hypotheses to compare on the whole grid."""
        return self.evidence.agreement + _peak(self.candidate_psr)

    @property
    def score(self) -> float:
        """Logarithm of the score that ranks hypotheses."""
        return self.evidence.score


def _log(share: float) -> float:
    return log(max(share, 0.02))


def _peak(psr: float) -> float:
    return log(max(psr, 3.0))


def poses(fits: Sequence[Fit]) -> tuple[Rotation, np.ndarray]:
    """(n,) rotations and (n, 3) shifts."""
    return Rotation.concatenate([fit.R for fit in fits]), np.array([fit.shift for fit in fits])


def elsewhere(some: Sequence[Hypothesis], others: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Those of `some` whose pose differs by 3 degrees or 2 voxels from the poses of all `others`."""
    if not some:
        return []
    (R, shifts), (other_R, other_shifts) = (poses([each.fit for each in listed]) for listed in (some, others))
    near = np.linalg.norm(shifts[:, None] - other_shifts, axis=-1) <= SAME_REFINED_SHIFT
    same = near & (np.abs(R.as_quat() @ other_R.as_quat().T) >= np.cos(_SAME_ROTATION / 2))
    return [each for each, known in zip(some, same, strict=True) if not known.any()]


def ranked(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Hypotheses by `candidate_score`, best first, without the weaker ones at the same pose."""
    order = np.argsort([-hypothesis.candidate_score for hypothesis in hypotheses], kind="stable")
    R, shifts = poses([hypothesis.fit for hypothesis in hypotheses])
    kept = distinct(R, order, len(hypotheses), _SAME_ROTATION, shifts, SAME_REFINED_SHIFT)
    return [hypotheses[k] for k in kept]
