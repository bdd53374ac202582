"""Poses that the translations' correlations name, before any of them is refined."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True, slots=True)
class Candidates:
    """n poses as arrays.

    Attributes:
        rotation: (n,) int64, which of the rotations that were followed.
        R: (n,) these rotations, R_target_source.
        shifts: (n, 3) p_target = R p_source + shift about the grid centers [voxels].
        psr: (n,) of the translation's peak.
        rotation_scores: (n,) of the rotation's peak, as `RotationPeaks` has it.
    """

    rotation: np.ndarray
    R: Rotation
    shifts: np.ndarray
    psr: np.ndarray
    rotation_scores: np.ndarray

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
        """All together."""
        return Candidates(
            rotation=np.concatenate([part.rotation for part in parts]),
            R=Rotation.concatenate([part.R for part in parts]),
            shifts=np.concatenate([part.shifts for part in parts]),
            psr=np.concatenate([part.psr for part in parts]),
            rotation_scores=np.concatenate([part.rotation_scores for part in parts]),
        )

    def select(self, selected: np.ndarray) -> "Candidates":
        """Those for which (n,) bool is true."""
        return Candidates(
            rotation=self.rotation[selected],
            R=self.R[selected],  # pyright: ignore[reportArgumentType]
            shifts=self.shifts[selected],
            psr=self.psr[selected],
            rotation_scores=self.rotation_scores[selected],
        )
