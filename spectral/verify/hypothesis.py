"""One pose that two scans may have to each other, and the evidence for it."""

from dataclasses import dataclass
from math import nan

import numpy as np

from spectral.verify.icp import Fit

# Refined poses nearer than this to each other are the same hypothesis [rad; voxels].
_SAME_ROTATION, SAME_REFINED_SHIFT = float(np.deg2rad(3.0)), 2.0
# A score is the translation's peak times this power of the views' consistency.
_POWER = 3


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A refined pose; what is not measured yet is NaN, and `dataclasses.replace` adds it.

    Attributes:
        fit: the pose and its information.
        rotation_score: of the rotation's peak that it comes from, as `RotationPeaks` has it.
        candidate_psr: peak-to-sidelobe ratio of the translation's peak that it comes from, before the refinement.
        consistency: how well the scans' views agree, 0..1; the overlap where no scan has a viewpoint.
        psr: peak-to-sidelobe ratio of the translation at the pose, on the whole grid.
        coarse_psr: the same on the coarse grid.
        overlap: share of points in common, 0..1, the smaller of both ways.
    """

    fit: Fit
    rotation_score: float
    candidate_psr: float
    consistency: float = nan
    psr: float = nan
    coarse_psr: float = nan
    overlap: float = nan

    @property
    def candidate_score(self) -> float:
        """What decides which hypotheses are compared on the whole grid: consistency and the candidate's peak."""
        return self.consistency**_POWER * max(self.candidate_psr, 0.0)

    @property
    def score(self) -> float:
        """What decides which hypothesis wins: consistency and the peaks of both grids.

        Where beams lie farther apart than voxels, the lines that they draw on a floor or a wall correlate on the whole
        grid, whatever stands there; on the coarse one less.
        """
        return self.consistency**_POWER * float(np.sqrt(max(self.psr, 0.0) * max(self.coarse_psr, 0.0)))


def alike(a: Fit, b: Fit) -> bool:
    """Whether two refined poses are the same: within 3 degrees and 2 voxels of each other."""
    turn = float((a.R.inv() * b.R).magnitude())
    return turn <= _SAME_ROTATION and bool(np.linalg.norm(a.shift - b.shift) <= SAME_REFINED_SHIFT)
