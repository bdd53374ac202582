"""Two scans' grids, in which they are correlated and refined, and their sensors' frames, which priors are about."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.geometry import cross_matrices
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.translation import Box
from sonarmap.spectral.verify.bounds import Bounds
from sonarmap.spectral.verify.fit import CALIBRATION, Fit
from sonarmap.spectral.verify.hypothesis import Candidates, Hypothesis
from sonarmap.spectral.verify.prior_term import PriorTerm

_SEEN_AT = 30.0  # from the sensor, about where it sees most [voxels]


@dataclass(frozen=True, slots=True)
class PairFrames:
    """Between the sensors of two scans [m] and the centers of their grids [voxels]; bounds are those of the sensors."""

    grid: Grid
    target: SpectralScan
    source: SpectralScan
    bounds: Bounds

    def transform(self, fit: Fit) -> RigidTransform:
        return RigidTransform.from_components(self._sensor_shift(fit.R, fit.shift), fit.R)

    def moved(self, fit: Fit) -> float:
        """How far the source's sensor is from where the target's was, and what it sees for its turn [voxels]."""
        T = self.transform(fit)
        turned = _SEEN_AT * float(T.rotation.magnitude())
        return float(np.hypot(np.linalg.norm(T.translation) / self.grid.voxel, turned))

    def _sensor_shift(self, R: Rotation, shift: np.ndarray) -> np.ndarray:
        """Where the source's sensor is in the target's frame (..., 3) [m], from shifts between the grids [voxels]."""
        return self.target.volume.center + shift * self.grid.voxel - R.apply(self.source.volume.center)

    def box(self, R: Rotation) -> Box | None:
        """The shifts between the grids' centers that position and depth leave [voxels]; None for all."""
        box = self.bounds.shift_box(R)
        if box is None:
            return None
        center = (box[0] - self.target.volume.center + R.apply(self.source.volume.center)) / self.grid.voxel
        return Box(np.rint(center), box[1] / self.grid.voxel)

    def within_bounds(self, candidates: Candidates) -> Candidates:
        allowed = np.zeros(len(candidates.psr), dtype=bool)
        for rotation in np.unique(candidates.rotation):
            indices = np.flatnonzero(candidates.rotation == rotation)
            R = candidates.R[int(indices[0])]
            allowed[indices] = self.bounds.allow_shifts(R, self._sensor_shift(R, candidates.shifts[indices]))
        return candidates.select(allowed)

    def possible(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        if not hypotheses:
            return []
        fits = [hypothesis.fit for hypothesis in hypotheses]
        allowed = self.bounds.allow_rotations(Rotation.concatenate([fit.R for fit in fits]))
        return [
            hypothesis
            for hypothesis, fit, turned in zip(hypotheses, fits, allowed, strict=True)
            if turned and self.bounds.allow_shifts(fit.R, self._sensor_shift(fit.R, fit.shift)[None])[0]
        ]

    def prior_at(self, R: Rotation, shifts: np.ndarray, stretches: bool) -> PriorTerm | None:
        """What instruments measured of k poses, and how a turn and a shift between the grids change it."""
        prior = self.bounds.prior
        if prior is None or not prior.measures:
            return None
        T = RigidTransform.from_components(self._sensor_shift(R, shifts), R)
        centers = R.apply(self.source.volume.center)
        # a turn about the grid's center moves the sensor
        sensor = np.zeros((len(shifts), 6, 6))
        sensor[:] = np.diag(np.repeat([1.0, self.grid.voxel], 3))
        sensor[:, 3:, :3] = cross_matrices(centers)
        voxel = self.grid.voxel
        from_target = self.target.volume.center / voxel + shifts
        lever = float(np.sqrt((self.source.surface.points**2).sum(axis=1).mean()))
        return PriorTerm(
            residual=prior.residuals(T),
            jacobian=prior.residual_jacobian(T) @ sensor,
            covariance=prior.residual_covariance(T),
            systematic=CALIBRATION.systematic(from_target, centers / voxel, np.full(len(shifts), lever), stretches),
        )
