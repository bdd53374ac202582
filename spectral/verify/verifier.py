"""Where would the scan lie under each rotation, and do the two scans then agree with what they saw?

Coarse to fine. On a grid of half the edge every rotation gets its translation correlation, of which several peaks are
taken, each with all shifts that a cyclic one stands for; points before the other scan's surface contradict. The best
few distinct ones are refined and compared on the whole grid. docs/registration.md has the figures.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from kernels.device.device import Device
from spectral.overlap import share_near
from spectral.prepare.range_image import COARSE, FINE, visibility
from spectral.prepare.spectral_scan import SpectralScan
from spectral.so3 import RotationPeaks
from spectral.translation import SAME_SHIFT, Translation, Volume
from spectral.verify.candidates import Candidates
from spectral.verify.hypothesis import Hypothesis, alike
from spectral.verify.icp import Fit

# Peaks of a rotation's translation that are looked at, and how far apart they are [coarse voxels].
_PEAKS, _SEPARATION = 8, 2.0
# A shift longer than this along an axis leaves the scans nothing in common [share of the grid's edge].
_FARTHEST = 0.92
# Candidates nearer than this to each other are the same [rad].
_SAME_ROTATION = float(np.deg2rad(5.0))
# Of scans without a viewpoint so many candidates, those with the highest peaks, are scored by their points in common.
_BY_POINTS, _POINTS = 60, 400
# Points by which a refined hypothesis' overlap is measured.
_OVERLAP_POINTS = 2000
# A contradiction weighs as so many agreements; a share of points that is small beside the least hardly counts.
_WEIGHT, _LEAST = 4.0, 0.05


def consistency(agree: np.ndarray | float, contradict: np.ndarray | float) -> np.ndarray | float:
    """The share of agreeing points among those that agree or contradict, 0..1; a contradiction counts several times.

    Not a share of all points: where scans have little in common few can agree, and few can contradict.
    """
    return agree / (agree + _WEIGHT * contradict + _LEAST)


class Verifier:
    """Finds candidates for rotations and measures hypotheses, on one device and grid."""

    def __init__(self, device: Device, edge: int) -> None:
        """Plan the correlations of both grids."""
        self.device, self.edge = device, edge
        self.coarse_edge = max(edge // 2, 16)
        self.translation = Translation(device, edge)
        self._coarse = Translation(device, self.coarse_edge)

    def candidates(self, target: SpectralScan, source: SpectralScan, rotations: RotationPeaks) -> Candidates:
        """Several shifts for each rotation, from the coarse grid, each with all shifts that a cyclic one stands for."""
        scale = self.edge / self.coarse_edge
        return self._candidates(self._coarse, target.coarse, source.coarse, rotations, scale)

    def fine_candidates(self, target: SpectralScan, source: SpectralScan, rotations: RotationPeaks) -> Candidates:
        """As `candidates`, from the whole grid: under a refined rotation there are higher peaks, and others."""
        return self._candidates(self.translation, target.volume, source.volume, rotations, 1.0)

    def _candidates(
        self, translation: Translation, target: Volume, source: Volume, rotations: RotationPeaks, scale: float
    ) -> Candidates:
        indices: list[int] = []
        shifts, ratios = [np.empty((0, 3))], []
        for index, R in enumerate(rotations.R):
            for peak in translation.find_all(target, source, R, _PEAKS, _SEPARATION):
                unwrapped = self._unwrapped(peak.shift * scale)
                shifts.append(unwrapped)
                indices += [index] * len(unwrapped)
                ratios += [peak.psr] * len(unwrapped)
        rotation = np.array(indices, dtype=np.int64)
        R = rotations.R[rotation]  # pyright: ignore[reportArgumentType]
        return Candidates(rotation, R, np.concatenate(shifts), np.array(ratios), rotations.scores[rotation])

    def _unwrapped(self, shift: np.ndarray) -> np.ndarray:
        """(n, 3): the shifts that a cyclic one stands for and that leave the scans something in common."""
        wrapped = shift - np.copysign(self.edge, shift)
        unwrapped = np.array(list(product(*zip(shift, wrapped, strict=True))))
        return unwrapped[(np.abs(unwrapped) <= _FARTHEST * self.edge).all(axis=1)]

    def best(
        self,
        target: SpectralScan,
        source: SpectralScan,
        candidates: Candidates,
        count: int,
        tolerance: tuple[float, float] = COARSE,
        apart: float = SAME_SHIFT,
    ) -> np.ndarray:
        """Indices of the `count` best distinct candidates, best first.

        Args:
            tolerance: how far from the surface a point may lie [voxels; of the range].
            apart: candidates of alike rotations that are no farther apart are the same [voxels].
        """
        order = np.argsort(-self._scores(target, source, candidates, tolerance), kind="stable")
        quaternions, nearest = candidates.R.as_quat(), np.cos(_SAME_ROTATION / 2)
        kept: list[int] = []
        for n in order:
            aligned = np.abs(quaternions[kept] @ quaternions[n]) > nearest
            near = np.linalg.norm(candidates.shifts[kept] - candidates.shifts[n], axis=1) <= apart
            if not (aligned & near).any():
                kept.append(int(n))
            if len(kept) == count:
                break
        return np.array(kept, dtype=np.int64)

    def rank(self, target: SpectralScan, source: SpectralScan, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        """The hypotheses with their consistency, best first; of those at the same pose the best alone."""
        if target.image.single or source.image.single:
            R = Rotation.concatenate([hypothesis.fit.R for hypothesis in hypotheses])
            shifts = np.array([hypothesis.fit.shift for hypothesis in hypotheses])
            seen = visibility(self.device, target.image, source.image, R, shifts, *FINE)
            agreement = np.asarray(consistency(seen.agree, seen.contradict)).tolist()
        else:
            agreement = [self.overlap(target, source, hypothesis.fit) for hypothesis in hypotheses]
        viewed = [replace(hypothesis, consistency=c) for hypothesis, c in zip(hypotheses, agreement, strict=True)]
        distinct: list[Hypothesis] = []
        for hypothesis in sorted(viewed, key=lambda hypothesis: -hypothesis.candidate_score):
            if not any(alike(hypothesis.fit, kept.fit) for kept in distinct):
                distinct.append(hypothesis)
        return distinct

    def overlap(self, target: SpectralScan, source: SpectralScan, fit: Fit) -> float:
        """The share of points in common, the smaller of both ways."""
        return self._overlap(target, source, fit.R, fit.shift, _OVERLAP_POINTS)

    def measure(self, target: SpectralScan, source: SpectralScan, hypothesis: Hypothesis, overlap: float) -> Hypothesis:
        """The hypothesis with the points in common and the translation's correlation on both grids."""
        R, shift = hypothesis.fit.R, hypothesis.fit.shift
        coarse = shift * self.coarse_edge / self.edge
        return replace(
            hypothesis,
            psr=self.translation.find_at(target.volume, source.volume, R, shift).psr,
            coarse_psr=self._coarse.find_at(target.coarse, source.coarse, R, coarse).psr,
            overlap=overlap,
        )

    def _scores(
        self, target: SpectralScan, source: SpectralScan, candidates: Candidates, tolerance: tuple[float, float]
    ) -> np.ndarray:
        """(n,) consistency times the peak's height."""
        if target.image.single or source.image.single:
            seen = visibility(self.device, target.image, source.image, candidates.R, candidates.shifts, *tolerance)
            agreement = np.asarray(consistency(seen.agree, seen.contradict))
        else:
            agreement = np.zeros(len(candidates.psr))
            for n in np.argsort(-candidates.psr, kind="stable")[:_BY_POINTS]:
                R, shift = candidates.R[int(n)], candidates.shifts[n]
                agreement[n] = self._overlap(target, source, R, shift, _POINTS)
        return agreement * np.maximum(candidates.psr, 0.0)

    @staticmethod
    def _overlap(target: SpectralScan, source: SpectralScan, R: Rotation, shift: np.ndarray, most: int) -> float:
        moved = R.apply(_sample(source.volume.surface, most)) + shift
        back = R.inv().apply(_sample(target.volume.surface, most) - shift)
        return min(share_near(target.volume, moved), share_near(source.volume, back))


def _sample(points: np.ndarray, most: int) -> np.ndarray:
    return points[:: max(1, -(-len(points) // most))]
