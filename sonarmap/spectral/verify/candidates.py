"""Poses that the translations' correlations name, before any of them is refined."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial.transform import Rotation


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
