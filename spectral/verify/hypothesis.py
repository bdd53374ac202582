"""What is known of a hypothesis on its way: a candidate, refined, verified."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from spectral.verify.icp import Fit

# Refined hypotheses are one if they come this near to each other [rad; voxels].
_ONE_ROTATION, ONE_SHIFT = float(np.deg2rad(3.0)), 2.0
# A hypothesis' score is the translation's peak times this power of the views' consistency.
_POWER = 3


@dataclass(frozen=True, slots=True)
class Candidates:
    """Places that the translations' correlations name, (n) each.

    Attributes:
        turn: which of the rotations.
        R: the rotations.
        shifts: (n, 3) p_target = R p_source + shift about the grid centers [voxels].
        psr: of the translation's peak.
        scores: of the rotation's peak, as `RotationPeaks` has it.
    """

    turn: np.ndarray
    R: Rotation
    shifts: np.ndarray
    psr: np.ndarray
    scores: np.ndarray

    def only(self, allowed: np.ndarray) -> "Candidates":
        """Those for which (n,) bool is true."""
        R = self.R[allowed]  # pyright: ignore[reportArgumentType]
        return Candidates(self.turn[allowed], R, self.shifts[allowed], self.psr[allowed], self.scores[allowed])

    def origin(self, n: int) -> "Origin":
        """Where hypothesis n comes from."""
        return Origin(float(self.scores[n]), float(self.psr[n]))


@dataclass(frozen=True, slots=True)
class Origin:
    """The candidate that a hypothesis comes from.

    Attributes:
        rotation_score: of the rotation's peak, as `RotationPeaks` has it.
        psr: of the translation's peak, before the refinement.
    """

    rotation_score: float
    psr: float


@dataclass(frozen=True, slots=True)
class Refined:
    """One hypothesis, refined, and what the views say to it.

    Attributes:
        fit: the refined pose and its information.
        origin: the candidate that it comes from.
        consistency: how the views agree, 0..1; the overlap where no scan has a viewpoint.
    """

    fit: Fit
    origin: Origin
    consistency: float

    @property
    def score(self) -> float:
        """What decides which are verified on the whole grid: both witnesses have to agree."""
        return self.consistency**_POWER * max(self.origin.psr, 0.0)


@dataclass(frozen=True, slots=True)
class Verified:
    """One hypothesis and all that speaks for and against it.

    Attributes:
        refined: the pose and its consistency.
        psr: of the translation there, on the whole grid.
        coarse_psr: the same on the coarse one.
        overlap: share of points in common, the smaller of both ways.
    """

    refined: Refined
    psr: float
    coarse_psr: float
    overlap: float

    @property
    def fit(self) -> Fit:
        """The refined pose and its information."""
        return self.refined.fit

    @property
    def score(self) -> float:
        """What decides which wins, as `Refined.score`.

        Both grids' peaks: where beams lie farther apart than voxels, the lines that they draw on a floor or a wall
        correlate on the whole grid, whatever stands there; on the coarse one less.
        """
        return self.refined.consistency**_POWER * float(np.sqrt(max(self.psr, 0.0) * max(self.coarse_psr, 0.0)))


def alike(a: Fit, b: Fit) -> bool:
    """Whether two refined poses came out at one place."""
    turn = float((a.R.inv() * b.R).magnitude())
    return turn <= _ONE_ROTATION and bool(np.linalg.norm(a.shift - b.shift) <= ONE_SHIFT)
