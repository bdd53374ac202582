"""Poses that the translations' correlations name, before any of them is refined."""

from dataclasses import dataclass

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

    def select(self, selected: np.ndarray) -> "Candidates":
        """Those for which (n,) bool is true."""
        return Candidates(
            rotation=self.rotation[selected],
            R=self.R[selected],  # pyright: ignore[reportArgumentType]
            shifts=self.shifts[selected],
            psr=self.psr[selected],
            rotation_scores=self.rotation_scores[selected],
        )
