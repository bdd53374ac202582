"""Bounds on the pose of a pair, by the bound on tilt and by instruments; and the frames of a pair."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.special import ndtr

from sonarmap.spectral.geometry import cross_matrices, tilt_allowed, tilt_refusal
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.prior import RelativePrior
from sonarmap.spectral.so3 import Sweep
from sonarmap.spectral.translation import Box
from sonarmap.spectral.verify.fit import CALIBRATION, Fit, PriorTerm
from sonarmap.spectral.verify.hypothesis import Candidates, Hypothesis

# Largest standard deviation of a measured tilt to search turns about the vertical alone [rad]: a rotation that is
# 4 degrees off has hardly a peak.
_SUREST_TILT = float(np.deg2rad(3.0))
# Turns about the vertical if the tilt is measured [rad].
_TURN_STEP = float(np.deg2rad(2.0))  # between turns that are correlated
_APART = float(np.deg2rad(7.0))  # least difference of selected turns
_NEAR = float(np.deg2rad(3.0))  # the same if headings bound the turns


def _ring(radius: float, begin: float) -> np.ndarray:
    """Six points (6, 2) around a circle."""
    angle = begin + np.arange(6) * np.pi / 3
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


# Tilts to correlate at each turn [standard deviations]
_TILTS = np.vstack([np.zeros((1, 2)), _ring(1.0, 0.0), _ring(2.0, np.pi / 6)])
_CONTRADICTION = 4.0  # standard deviations from which scans contradict instruments
# Largest errors of a right place.
NEAR_TURN = float(np.deg2rad(12.0))  # [rad]
NEAR_SHIFT = 8.0  # [voxels]
_RIGHT = 0.95  # probability that both scans' instruments are right within their sigmas
_KNOWN_TILT = -2.5  # log10 of the share of all tilts that a tilt known to a few degrees leaves
# Tolerances for poses before the refinement.
_ROTATION_SLACK = float(np.deg2rad(6.0))  # of rotations from the correlation [rad]
_SHIFT_SLACK = 6.0  # of shifts on the coarse grid [halves of its voxel]


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds on the pose of one pair."""

    max_tilt: float  # largest roll and pitch [rad]; pi for none
    prior: RelativePrior | None  # of the scans' priors, or None
    voxel: float  # half of the coarse grid's, the unit of the tolerance of shifts [m]
    # whether instruments measured the prior, so that it is evidence for the place of a pose, too
    by_instruments: bool = True

    @property
    def measured(self) -> Rotation | None:
        """R_target_source if both priors measure it in full, else None."""
        return None if self.prior is None else self.prior.R_target_source

    @property
    def sweep(self) -> Sweep | None:
        """R_target_source that attitudes and headings allow: turns about the vertical, each with the measured tilt and
        with tilts within 2 standard deviations of it. None without accurate attitudes."""
        prior = self.prior
        if prior is None or not prior.knows_tilt or prior.tilt_sigma > _SUREST_TILT:
            return None
        reach = min(prior.turn_reach, np.pi * (1 - 1e-9))
        count = 2 * int(np.ceil(reach / _TURN_STEP)) + 1
        bounded = reach < np.pi - _TURN_STEP
        turns = np.linspace(-reach, reach, count) if bounded else np.arange(0, 2 * np.pi, _TURN_STEP)
        return Sweep(prior.turned(turns, prior.tilt_sigma * _TILTS), len(_TILTS), _NEAR if bounded else _APART)

    def shift_box(self, R_target_source: Rotation) -> tuple[np.ndarray, np.ndarray] | None:
        """Center (3,) and half widths (..., 3) [m] of the box that holds the source's sensor, along the target's axes,
        for each rotation; None if position and depth do not bound all three axes."""
        box = None if self.prior is None else self.prior.shift_box(R_target_source)
        return None if box is None else (box[0], box[1] + _SHIFT_SLACK * self.voxel)

    def search(self, extent: float) -> float:
        """log10 of the share, at most 1, of all poses within an extent [m] that instruments allow."""
        prior = self.prior
        if prior is None:
            return 0.0
        share = _KNOWN_TILT + float(np.log10(prior.turn_reach / np.pi)) if prior.knows_tilt else 0.0
        reach = prior.shift_reach + _SHIFT_SLACK * self.voxel
        return share + float(np.log10(np.minimum(reach / extent, 1.0)).sum())

    def odds_of_place(self, T_target_source: RigidTransform, voxel: float) -> float:
        """Odds by the instruments alone that a pose is at the right place; at least 1, which wide bounds give: of the
        pairs that the probability was fitted to, about half were right. The voxel is in meters."""
        prior = self.prior if self.by_instruments else None
        if prior is None or not prior.is_complete:
            return 1.0
        at = prior.at(T_target_source.rotation, T_target_source.translation)
        off, sigmas = at.residual[0], np.sqrt(np.diagonal(at.covariance[0]))
        near = np.repeat([NEAR_TURN, NEAR_SHIFT * voxel], 3)
        share = _RIGHT * float(np.prod(ndtr((off + near) / sigmas) - ndtr((off - near) / sigmas)))
        return max(share / (1 - share), 1.0)

    def allow_rotations(self, R_target_source: Rotation) -> np.ndarray:
        """(n,) bool, which of n rotations are allowed."""
        allowed = tilt_allowed(R_target_source, self.max_tilt)
        return allowed if self.prior is None else allowed & self.prior.allows(R_target_source, _ROTATION_SLACK)

    def allow_shifts(self, R_target_source: Rotation, shifts: np.ndarray) -> np.ndarray:
        """(n,) bool, which positions (n, 3) [m] of the source's sensor in the target's frame are allowed."""
        if self.prior is None:
            return np.ones(len(shifts), dtype=bool)
        return self.prior.allows_shift(shifts, R_target_source, _SHIFT_SLACK * self.voxel)

    def refusal(self, R: Rotation, t: np.ndarray) -> str:
        """Reason to refuse a pose R_target_source, t [m], in words; "" if it is allowed."""
        if refusal := tilt_refusal(R, self.max_tilt):
            return refusal
        if not (self.allow_rotations(R) and self.allow_shifts(R, t[None])[0]):
            return "it contradicts the scans' priors by more than four standard deviations"
        return ""

    def contradiction(self, T_target_source: RigidTransform) -> str:
        """A warning, in words, if a pose by the scans alone contradicts the instruments; else ""."""
        if self.prior is None:
            return ""
        squared, count = self.prior.normalized(T_target_source)
        if squared <= _CONTRADICTION**2 + count:
            return ""
        return "the pose by the scans alone contradicts navigation; "


_SEEN_AT = 30.0  # typical distance of a point from the sensor [voxels]


@dataclass(frozen=True, slots=True)
class PairFrames:
    """Conversion between poses of the sensors [m], which bounds refer to, and of the grids' centers [voxels]."""

    grid: Grid
    target: SpectralScan
    source: SpectralScan
    bounds: Bounds

    def transform(self, fit: Fit) -> RigidTransform:
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = fit.R.as_matrix(), self._sensor_shift(fit.R, fit.shift)
        return RigidTransform(T, normalize=False)

    def moved(self, R: Rotation, shifts: np.ndarray) -> np.ndarray:
        """(n,) distances between the sensors and displacements of typical points by the turn, added in squares
        [voxels], by shifts (n, 3) between the grids [voxels]."""
        away = np.linalg.norm(self._sensor_shift(R, shifts), axis=1) / self.grid.voxel
        return np.hypot(away, _SEEN_AT * R.magnitude())

    def _sensor_shift(self, R: Rotation, shift: np.ndarray) -> np.ndarray:
        """Position (..., 3) [m] of the source's sensor in the target's frame, by shifts between the grids [voxels]."""
        return self.target.volume.center + shift * self.grid.voxel - R.apply(self.source.volume.center)

    def boxes(self, R: Rotation) -> list[Box | None]:
        """Shifts between the grids' centers that position and depth allow under each of n rotations [voxels]; None for
        all."""
        box = self.bounds.shift_box(R)
        if box is None:
            return [None] * len(R)
        centers = (box[0] - self.target.volume.center + R.apply(self.source.volume.center)) / self.grid.voxel
        return [Box(center, half) for center, half in zip(np.rint(centers), box[1] / self.grid.voxel, strict=True)]

    def within_bounds(self, candidates: Candidates) -> Candidates:
        sensors = self._sensor_shift(candidates.R, candidates.shifts)
        return candidates.select(self.bounds.allow_shifts(candidates.R, sensors))

    def possible(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        if not hypotheses:
            return []
        R = Rotation.concatenate([hypothesis.fit.R for hypothesis in hypotheses])
        sensors = self._sensor_shift(R, np.array([hypothesis.fit.shift for hypothesis in hypotheses]))
        allowed = self.bounds.allow_rotations(R) & self.bounds.allow_shifts(R, sensors)
        return [hypothesis for hypothesis, inside in zip(hypotheses, allowed, strict=True) if inside]

    def prior_at(self, prior: RelativePrior, R: Rotation, shifts: np.ndarray, stretches: bool) -> PriorTerm:
        """Residuals of k poses by instruments, and their Jacobian by a turn and a shift between the grids."""
        off = prior.at(R, self._sensor_shift(R, shifts))
        centers = R.apply(self.source.volume.center)
        # a turn about the grid's center also moves the sensor
        sensor = np.zeros((len(shifts), 6, 6))
        sensor[:] = np.diag(np.repeat([1.0, self.grid.voxel], 3))
        sensor[:, 3:, :3] = cross_matrices(centers)
        voxel = self.grid.voxel
        from_target = self.target.volume.center / voxel + shifts
        lever = np.full(len(shifts), self.source.surface.lever)
        return PriorTerm(
            residual=off.residual,
            jacobian=off.jacobian @ sensor,
            covariance=off.covariance,
            systematic=CALIBRATION.systematic(from_target, centers / voxel, lever, stretches),
        )
