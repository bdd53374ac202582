"""Which poses of a pair are possible, by the bound on tilt and by instruments; and the frames that these are in."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.geometry import cross_matrices, tilt_allowed, tilt_refusal
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.prior import RelativePrior
from sonarmap.spectral.so3 import Sweep
from sonarmap.spectral.translation import Box
from sonarmap.spectral.verify.fit import CALIBRATION, Fit, PriorTerm
from sonarmap.spectral.verify.hypothesis import Candidates, Hypothesis

# Instruments that leave a tilt less sure than this are left to the correlation of the spectra [rad]: a rotation that is
# 4 degrees off has hardly a peak.
_SUREST_TILT = float(np.deg2rad(3.0))
# Turns about the vertical where the tilt is known [rad].
_TURN_STEP = float(np.deg2rad(2.0))  # between those that are tried
_APART = float(np.deg2rad(7.0))  # between those that are followed
_NEAR = float(np.deg2rad(3.0))  # and of few that headings leave


def _ring(radius: float, begin: float) -> np.ndarray:
    """(6, 2) around a circle."""
    angle = begin + np.arange(6) * np.pi / 3
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


# The tilts that are tried [standard deviations].
_TILTS = np.vstack([np.zeros((1, 2)), _ring(1.0, 0.0), _ring(2.0, np.pi / 6)])
_CONTRADICTION = 4.0  # standard deviations from which on scans contradict instruments
_KNOWN_TILT = -2.5  # a tilt known to a few degrees, as a share of all that are searched without; logarithm, base 10
# What may be off that is not refined.
_ROTATION_SLACK = float(np.deg2rad(6.0))  # of the correlation [rad]
_SHIFT_SLACK = 6.0  # of the coarse grid [halves of its voxel]


@dataclass(frozen=True, slots=True)
class Bounds:
    """What bounds the pose of one pair."""

    max_tilt: float  # largest roll and pitch [rad]; pi for none
    prior: RelativePrior | None  # what the scans' priors say, or None
    voxel: float  # half of the coarse grid's, which decides how coarse a shift is [m]

    @property
    def measured(self) -> Rotation | None:
        """R_target_source where both priors measure it in full, else None."""
        return None if self.prior is None else self.prior.R_target_source

    @property
    def sweep(self) -> Sweep | None:
        """R_target_source that attitudes and headings leave: all turns about the vertical, each with the measured tilt
        and with tilts as far from it as the measurements usually are. None without sure attitudes."""
        prior = self.prior
        if prior is None or not prior.knows_tilt or prior.tilt_sigma > _SUREST_TILT:
            return None
        reach = min(prior.turn_reach, np.pi * (1 - 1e-9))
        count = 2 * int(np.ceil(reach / _TURN_STEP)) + 1
        bounded = reach < np.pi - _TURN_STEP
        turns = np.linspace(-reach, reach, count) if bounded else np.arange(0, 2 * np.pi, _TURN_STEP)
        return Sweep(prior.turned(turns, prior.tilt_sigma * _TILTS), len(_TILTS), _NEAR if bounded else _APART)

    def shift_box(self, R_target_source: Rotation) -> tuple[np.ndarray, np.ndarray] | None:
        """Center (3,) and half widths (3,) [m] of the places of the source's sensor, in the target's axes; None where
        position and depth do not bound all three."""
        box = None if self.prior is None else self.prior.shift_box(R_target_source)
        return None if box is None else (box[0], box[1] + _SHIFT_SLACK * self.voxel)

    def search(self, extent: float) -> float:
        """The logarithm, base 10, of the share, at most 1, of all poses that instruments leave within an extent [m]."""
        prior = self.prior
        if prior is None:
            return 0.0
        share = _KNOWN_TILT + float(np.log10(prior.turn_reach / np.pi)) if prior.knows_tilt else 0.0
        reach = prior.shift_reach + _SHIFT_SLACK * self.voxel
        return share + float(np.log10(np.minimum(reach / extent, 1.0)).sum())

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
        R, t = T_target_source.rotation, T_target_source.translation
        if refusal := tilt_refusal(R, self.max_tilt):
            return refusal
        if not (self.allow_rotations(R) and self.allow_shifts(R, t[None])[0]):
            return "it contradicts the scans' priors by more than four standard deviations"
        return ""

    def contradiction(self, T_target_source: RigidTransform) -> str:
        """That a pose by the scans alone contradicts the instruments, in words; "" where it does not."""
        if self.prior is None:
            return ""
        squared, count = self.prior.normalized(T_target_source)
        if squared <= _CONTRADICTION**2 + count:
            return ""
        return "the scans alone do not match where navigation puts them; "


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
