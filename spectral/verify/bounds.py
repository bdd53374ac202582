"""Which poses of a pair are possible at all: by the bound on roll and pitch, and by what other instruments say."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from spectral.prior import RelativePrior
from spectral.tilt import tilt_allowed, tilt_refusal

# What a rotation of the correlation, and a shift of the coarse grid, may be off by, not being refined [rad; voxels].
_ROTATION_SLACK, _SHIFT_SLACK = float(np.deg2rad(6.0)), 6.0


@dataclass(frozen=True, slots=True)
class Bounds:
    """What bounds the pose of one pair.

    Attributes:
        max_tilt: largest roll and pitch [rad]; pi for none.
        prior: what the scans' priors say, or None.
        voxel: of the grid, which decides how coarse a shift is [m].
    """

    max_tilt: float
    prior: RelativePrior | None
    voxel: float

    @property
    def measured(self) -> Rotation | None:
        """R_target_source where both priors measure it in full, else None."""
        return None if self.prior is None else self.prior.R_target_source

    def allow_rotations(self, R_target_source: Rotation) -> np.ndarray:
        """Which of n rotations are possible, (n,) bool."""
        allowed = tilt_allowed(R_target_source, self.max_tilt)
        return allowed if self.prior is None else allowed & self.prior.allows(R_target_source, _ROTATION_SLACK)

    def allow_shifts(self, R_target_source: Rotation, shifts: np.ndarray) -> np.ndarray:
        """Which of the places of the source's sensor in the target's frame (n, 3) [m] are possible, (n,) bool."""
        if self.prior is None:
            return np.ones(len(shifts), dtype=bool)
        return self.prior.allows_shift(shifts, R_target_source, _SHIFT_SLACK * self.voxel)

    def refusal(self, T_target_source: RigidTransform) -> str:
        """Why a pose is impossible, in words; "" where it is not."""
        R, t = T_target_source.rotation, T_target_source.translation
        if refusal := tilt_refusal(R, self.max_tilt):
            return refusal
        if not (self.allow_rotations(R) and self.allow_shifts(R, t[None])[0]):
            return "it contradicts the scans' priors by more than four standard deviations"
        return ""
