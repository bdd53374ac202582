"""The hypotheses about one pair of scans: bounded, refined, compared, and the best refined to the end."""

from collections.abc import Iterable
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from spectral.grid import Grid
from spectral.prepare.range_image import FINE
from spectral.prepare.spectral_scan import SpectralScan
from spectral.rotation_search import search_rotation
from spectral.so3 import RotationPeaks
from spectral.verify.bounds import Bounds
from spectral.verify.candidates import Candidates
from spectral.verify.hypothesis import SAME_REFINED_SHIFT, Hypothesis, alike
from spectral.verify.icp import Fit, refine
from spectral.verify.verifier import Verifier

# Reaches of the refinement's steps [voxels] and its points: out of a candidate's error; until hypotheses can be
# compared; and, for the best alone, on to the end.
_ROUGH, _ROUGH_POINTS = (4.0, 3.0, 3.0, 2.0, 2.0, 2.0), 500
_CLOSE, _CLOSE_POINTS = (3.0, 2.0, 2.0) + (1.5,) * 6, 1000
_FINAL, _FINAL_POINTS = (1.5,) * 8, 3000
# Refined rotations nearer than this have the same correlation on the whole grid [rad].
_SAME_ROTATION = float(np.deg2rad(1.0))


@dataclass(frozen=True, slots=True)
class HypothesisTest:
    """One pair of scans, and which poses are possible between them.

    Attributes:
        verifier: of the grid.
        pool: threads that refine hypotheses side by side; the results are the same however many they are.
        grid: that both scans share.
        target, source: the scans.
        bounds: which poses are possible.
    """

    verifier: Verifier
    pool: Executor
    grid: Grid
    target: SpectralScan
    source: SpectralScan
    bounds: Bounds

    def find_candidates(self, rotations: RotationPeaks) -> Candidates:
        """Where the scan would lie under each of the rotations, by the coarse grid; possible places only."""
        return self._within_bounds(self.verifier.candidates(self.target, self.source, rotations))

    def refine_candidates(self, candidates: Candidates, count: int) -> list[Hypothesis]:
        """The `count` best candidates, refined roughly, best first; impossible ones only where there are no others."""
        best = self.verifier.best(self.target, self.source, candidates, count)
        hypotheses = self._rank(self._refine_roughly(candidates, best))
        return self._possible(hypotheses) or hypotheses

    def find_missed(self, finalists: list[Hypothesis]) -> list[Hypothesis]:
        """What the whole grid's correlations under the finalists' refined rotations name beside the finalists.

        A rotation that is 2 degrees off has low and broad peaks, and where a scan can slide, along a quay or a pool,
        the true one may be missing among them. As many at most as there are finalists.
        """
        distinct: list[Hypothesis] = []
        for finalist in finalists:
            if all((finalist.fit.R.inv() * kept.fit.R).magnitude() > _SAME_ROTATION for kept in distinct):
                distinct.append(finalist)
        R = Rotation.concatenate([finalist.fit.R for finalist in distinct])
        rotations = RotationPeaks(R, np.array([finalist.rotation_score for finalist in distinct]))
        candidates = self._within_bounds(self.verifier.fine_candidates(self.target, self.source, rotations))
        count = 2 * len(finalists)
        best = self.verifier.best(self.target, self.source, candidates, count, FINE, SAME_REFINED_SHIFT)
        hypotheses = self._refine_roughly(candidates, best)
        missed = [new for new in hypotheses if not any(alike(new.fit, finalist.fit) for finalist in finalists)]
        return self._possible(self._rank(missed))[: len(finalists)] if missed else []

    def compare(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        """Measured on the whole grid, best first; all refined alike, as an advantage in that would look like evidence.

        Of those that came out at the same pose the best alone is kept.
        """

        def refine_closely(hypothesis: Hypothesis) -> Hypothesis:
            fit = self._refine(hypothesis.fit.R, hypothesis.fit.shift, _CLOSE, _CLOSE_POINTS)
            return replace(hypothesis, fit=fit)

        return self._measure(self.pool.map(refine_closely, hypotheses))

    def finish(self, hypotheses: list[Hypothesis], spectral: bool) -> list[Hypothesis]:
        """The best hypothesis refined to the end, and the others that are not now where it is.

        Args:
            hypotheses: best first.
            spectral: whether the best climbs the translation's peak over the rotation, instead of the planes.
        """
        best = self._finish_best(hypotheses[0], spectral)
        return [best, *(hypothesis for hypothesis in hypotheses[1:] if not alike(hypothesis.fit, best.fit))]

    def transform(self, fit: Fit) -> RigidTransform:
        """T_target_source between the sensor frames [m]."""
        return RigidTransform.from_components(self._sensor_shift(fit.R, fit.shift), fit.R)

    def _finish_best(self, best: Hypothesis, spectral: bool) -> Hypothesis:
        fit = self._refine(best.fit.R, best.fit.shift, _FINAL, _FINAL_POINTS)
        if spectral:
            translation, target, source = self.verifier.translation, self.target.volume, self.source.volume
            peak = translation.find_at(target, source, best.fit.R, best.fit.shift)
            R, peak = search_rotation(translation, target, source, best.fit.R, peak, stay=True)
            near = peak.shift + self.grid.edge * np.rint((best.fit.shift - peak.shift) / self.grid.edge)
            fit = replace(fit, R=R, shift=near)
        return self._measure([replace(best, fit=fit)])[0]

    def _sensor_shift(self, R: Rotation, shift: np.ndarray) -> np.ndarray:
        """Where the source's sensor is in the target's frame (..., 3) [m], from shifts between the grids [voxels]."""
        return self.target.volume.center + shift * self.grid.voxel - R.apply(self.source.volume.center)

    def _within_bounds(self, candidates: Candidates) -> Candidates:
        """Those whose shift is possible."""
        allowed = np.zeros(len(candidates.psr), dtype=bool)
        for rotation in np.unique(candidates.rotation):
            indices = np.flatnonzero(candidates.rotation == rotation)
            R = candidates.R[int(indices[0])]
            allowed[indices] = self.bounds.allow_shifts(R, self._sensor_shift(R, candidates.shifts[indices]))
        return candidates.select(allowed)

    def _possible(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        return [hypothesis for hypothesis in hypotheses if not self.bounds.refusal(self.transform(hypothesis.fit))]

    def _rank(self, hypotheses: Iterable[Hypothesis]) -> list[Hypothesis]:
        return self.verifier.rank(self.target, self.source, list(hypotheses))

    def _measure(self, hypotheses: Iterable[Hypothesis]) -> list[Hypothesis]:
        """Distinct hypotheses with all their evidence, best first."""
        target, source, ranked = self.target, self.source, self._rank(hypotheses)
        # the threads count points while the device correlates
        overlaps = self.pool.map(lambda hypothesis: self.verifier.overlap(target, source, hypothesis.fit), ranked)
        measured = [self.verifier.measure(target, source, *pair) for pair in zip(ranked, overlaps, strict=True)]
        return sorted(measured, key=lambda hypothesis: -hypothesis.score)

    def _refine_roughly(self, candidates: Candidates, chosen: np.ndarray) -> list[Hypothesis]:
        """The chosen candidates, refined."""

        def refine_candidate(n: int) -> Hypothesis:
            fit = self._refine(candidates.R[n], candidates.shifts[n], _ROUGH, _ROUGH_POINTS)
            return Hypothesis(fit, float(candidates.rotation_scores[n]), float(candidates.psr[n]))

        return list(self.pool.map(refine_candidate, chosen.tolist()))

    def _refine(self, R: Rotation, shift: np.ndarray, reaches: tuple[float, ...], points: int) -> Fit:
        return refine(self.target.surface, self.source.surface, R, shift, reaches, points)
