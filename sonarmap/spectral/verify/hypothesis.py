"""Candidate poses, and a hypothesis: one pose that two scans may have to each other, with the evidence for it."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from math import isnan, log, nan

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.spectral.fitted import FITTED
from sonarmap.spectral.verify.fit import Fit


@dataclass(frozen=True, slots=True)
class Candidates:
    """n poses as arrays."""

    rotation: np.ndarray  # (n,) int64, which of the rotations that were followed
    R: Rotation  # (n,) these rotations, R_target_source
    shifts: np.ndarray  # (n, 3) p_target = R p_source + shift about the grid centers [voxels]
    psr: np.ndarray  # (n,) of the translation's peak
    rotation_scores: np.ndarray  # (n,) of the rotation's peak, as `RotationPeaks` has it

    def usual_height(self) -> float:
        """The median over the rotations of their highest peak; 1 where there is none above 0."""
        highest = [self.psr[self.rotation == rotation].max() for rotation in np.unique(self.rotation)]
        usual = float(np.median(highest)) if highest else 0.0
        return usual if usual > 0 else 1.0

    def raised(self, factor: float) -> "Candidates":
        """The same with peaks of `factor` times the height."""
        return replace(self, psr=self.psr * factor)

    @staticmethod
    def joined(parts: "Sequence[Candidates]") -> "Candidates":
        rows = {name: [getattr(part, name) for part in parts] for name in _NAMES}
        R = Rotation.concatenate(rows.pop("R"))
        return Candidates(R=R, **{name: np.concatenate(arrays) for name, arrays in rows.items()})

    def select(self, selected: np.ndarray) -> "Candidates":
        return Candidates(*(getattr(self, name)[selected] for name in _NAMES))


_NAMES = [field.name for field in fields(Candidates)]


MOST_MEASURED = 30.0  # chi-squared; what is farther from what instruments measured counts as much
# Powers of the evidence in a score, each for its logarithm, of residual and width for that of their inverse; those of
# `surface_alone` and `overlap` count where there is no view. Distorted scans follow instruments less than in full, so
# the power of `measured` is small. docs/registration.md says how they were fitted.
_POWERS: dict[str, float] = FITTED["ranking"]
# Refined poses nearer than this to each other are the same hypothesis.
_SAME_ROTATION = float(np.deg2rad(3.0))  # [rad]
SAME_REFINED_SHIFT = 2.0  # [voxels]


@dataclass(frozen=True, slots=True)
class Evidence:
    """What speaks for a pose; what is not measured yet is NaN."""

    # consistency of what the scans' sensors saw, 0..1, with a tight tolerance; NaN where no viewpoint is known
    view: float = nan
    coarse_view: float = nan  # the same with a wide tolerance
    surface: float = nan  # consistency of the surfaces, 0..1, as `SharedSurface` has it
    overlap: float = nan  # share of points in common, 0..1, the smaller of both ways
    # weighted rms distance of the shared points to each other's planes [voxels]. Where noise is small it tells a
    # surface from another that is nearly the same.
    residual: float = nan
    width: float = nan  # median distance of all points near each other's planes [voxels], as `Fit` has it
    firmness: float = nan  # how firmly their planes hold the pose, 0..1, as `Fit` has it
    psr: float = nan  # peak-to-sidelobe ratio of the translation at the pose, on the whole grid, phase only
    moved: float = nan  # from where nothing has moved, as `PairFrames` has it [voxels]
    measured: float = 0.0  # chi-squared of the pose by what instruments measured; 0 where they measured nothing
    # logarithm of how close the surfaces come, by the inverse of the residual, where that helps to tell places that
    # look alike apart; 0 where it does not
    closeness: float = 0.0

    @property
    def consistency(self) -> float:
        """0..1: of the views, else of the surfaces."""
        return self.surface if isnan(self.view) else self.view

    @property
    def agreement(self) -> float:
        """The logarithm of how well the scans agree, before they are correlated at the pose."""
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
        """The logarithm of what decides which hypothesis wins. Where beams lie farther apart than voxels, the lines
        that they draw on a floor or a wall correlate, whatever stands there: so a peak says little."""
        return self.agreement + _POWERS["psr"] * _peak(self.psr) + _POWERS["closeness"] * self.closeness


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A refined pose, and what speaks for it."""

    fit: Fit  # the pose and its information
    rotation_score: float  # of the rotation's peak that it comes from, as `RotationPeaks` has it
    candidate_psr: float  # peak-to-sidelobe ratio of the translation's peak that it comes from, before the refinement
    evidence: Evidence = Evidence()  # measured at the pose

    @property
    def candidate_score(self) -> float:
        """The logarithm of what decides which hypotheses are compared on the whole grid."""
        return self.evidence.agreement + _peak(self.candidate_psr)

    @property
    def score(self) -> float:
        """The logarithm of what decides which hypothesis wins."""
        return self.evidence.score


def _log(share: float) -> float:
    return log(max(share, 0.02))


def _peak(psr: float) -> float:
    return log(max(psr, 3.0))


def same_poses(some: Sequence[Fit], others: Sequence[Fit]) -> np.ndarray:
    """(n, m) whether each of some refined poses is the same as each of others: within 3 degrees and 2 voxels."""
    (turns, shifts), (other_turns, other_shifts) = map(_poses, (some, others))
    near = np.linalg.norm(shifts[:, None] - other_shifts, axis=-1) <= SAME_REFINED_SHIFT
    return near & (np.abs(turns @ other_turns.T) >= np.cos(_SAME_ROTATION / 2))


def elsewhere(some: Sequence[Hypothesis], others: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Those of some hypotheses whose pose is that of none of the others."""
    same = same_poses([each.fit for each in some], [each.fit for each in others])
    return [each for each, known in zip(some, same, strict=True) if not known.any()]


def _poses(fits: Sequence[Fit]) -> tuple[np.ndarray, np.ndarray]:
    """Quaternions (n, 4) and shifts (n, 3)."""
    turns = np.array([fit.R.as_quat() for fit in fits]).reshape(-1, 4)
    return turns, np.array([fit.shift for fit in fits]).reshape(-1, 3)


def ranked(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Hypotheses by what the scans saw, best first; of those at the same pose the best alone."""
    ordered = sorted(hypotheses, key=lambda hypothesis: -hypothesis.candidate_score)
    fits = [hypothesis.fit for hypothesis in ordered]
    same, kept = same_poses(fits, fits), list[int]()
    for k in range(len(ordered)):
        if not same[k, kept].any():
            kept.append(k)
    return [ordered[k] for k in kept]
