"""The hypotheses about one pair of scans: bounded, refined, compared, and the best brought to its end."""

from collections.abc import Iterable
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from spectral.grid import Grid
from spectral.prepare.spectral_scan import SpectralScan
from spectral.rotation_search import search_rotation
from spectral.so3 import RotationPeaks
from spectral.verify.bounds import Bounds
from spectral.verify.hypothesis import ONE_SHIFT, Candidates, Origin, Refined, Verified, alike
from spectral.verify.icp import Fit, refine
from spectral.verify.verifier import FINE, Verifier

# Reaches of the refinement's steps [voxels] and its points: out of a candidate's error; until hypotheses can be
# compared; and, for the best alone, on to the end.
_ROUGH, _ROUGH_POINTS = (4.0, 3.0, 3.0, 2.0, 2.0, 2.0), 500
_CLOSE, _CLOSE_POINTS = (3.0, 2.0, 2.0) + (1.5,) * 6, 1000
_FINAL, _FINAL_POINTS = (1.5,) * 8, 3000
# Refined rotations nearer than this have the same correlation on the whole grid [rad].
_SAME_TURN = float(np.deg2rad(1.0))


@dataclass(frozen=True, slots=True)
class Contest:
    """One pair of scans, and what may be meant between them.

    Attributes:
        verifier: of the grid.
        pool: threads that refine hypotheses side by side; the results are the same however many they are.
        grid: that both scans share.
        target, source: the scans.
        bounds: what may be meant.
    """

    verifier: Verifier
    pool: Executor
    grid: Grid
    target: SpectralScan
    source: SpectralScan
    bounds: Bounds

    def candidates(self, rotations: RotationPeaks) -> Candidates:
        """Where the scan would lie under each of the rotations, as far as it may be meant."""
        return self._bounded(self.verifier.candidates(self.target, self.source, rotations))

    def refined(self, candidates: Candidates, count: int) -> list[Refined]:
        """The best candidates, refined roughly, best first; impossible ones only where there are no others."""
        best = self.verifier.best(self.target, self.source, candidates, count)
        judged = self._judged(self._roughly(candidates, best))
        return self._possible(judged) or judged

    def missed(self, finalists: list[Refined]) -> list[Refined]:
        """What the whole grid's correlations under the refined rotations name beside the finalists.

        A rotation that is 2 degrees off has low and broad peaks, and where a scan can slide, along a quay or a pool,
        the true one may be missing among them. As many at most as there are finalists.
        """
        turns: list[Refined] = []
        for one in finalists:
            if all((one.fit.R.inv() * other.fit.R).magnitude() > _SAME_TURN for other in turns):
                turns.append(one)
        R = Rotation.concatenate([one.fit.R for one in turns])
        rotations = RotationPeaks(R, np.array([one.origin.rotation_score for one in turns]))
        candidates = self._bounded(self.verifier.fine_candidates(self.target, self.source, rotations))
        best = self.verifier.best(self.target, self.source, candidates, 2 * len(finalists), FINE, ONE_SHIFT)
        fits = self._roughly(candidates, best)
        new = [(fit, origin) for fit, origin in fits if not any(alike(fit, one.fit) for one in finalists)]
        return self._possible(self._judged(new))[: len(finalists)] if new else []

    def compared(self, hypotheses: list[Refined]) -> list[Verified]:
        """On the whole grid, best first; all refined alike, as an advantage in that would look like belief."""
        fits = self.pool.map(lambda one: self._refine(one.fit.R, one.fit.shift, _CLOSE, _CLOSE_POINTS), hypotheses)
        return self._verified(zip(fits, (one.origin for one in hypotheses), strict=True))

    def settled(self, found: list[Verified], spectral: bool) -> list[Verified]:
        """The best refined to the end, and the others that are not now where it is.

        Args:
            found: best first.
            spectral: whether the best climbs the translation's peak over the rotation, instead of the planes.
        """
        best = self._finished(found[0], spectral)
        return [best, *(one for one in found[1:] if not alike(one.fit, best.fit))]

    def transform(self, fit: Fit) -> RigidTransform:
        """T_target_source between the sensor frames."""
        return RigidTransform.from_components(self._shift(fit.R, fit.shift), fit.R)

    def _finished(self, best: Verified, spectral: bool) -> Verified:
        fit = self._refine(best.fit.R, best.fit.shift, _FINAL, _FINAL_POINTS)
        if spectral:
            translation, target, source = self.verifier.translation, self.target.volume, self.source.volume
            peak = translation.find_at(target, source, best.fit.R, best.fit.shift)
            R, peak = search_rotation(translation, target, source, best.fit.R, peak, stay=True)
            near = peak.shift + self.grid.edge * np.rint((best.fit.shift - peak.shift) / self.grid.edge)
            fit = replace(fit, R=R, shift=near)
        return self._verified([(fit, best.refined.origin)])[0]

    def _shift(self, R: Rotation, shift: np.ndarray) -> np.ndarray:
        """Where the source's sensor is in the target's frame (..., 3) [m], from shifts between the grids [voxels]."""
        return self.target.volume.center + shift * self.grid.voxel - R.apply(self.source.volume.center)

    def _bounded(self, candidates: Candidates) -> Candidates:
        """Those whose shift may be meant."""
        allowed = np.zeros(len(candidates.psr), dtype=bool)
        for turn in np.unique(candidates.turn):
            these = np.flatnonzero(candidates.turn == turn)
            R = candidates.R[int(these[0])]
            allowed[these] = self.bounds.allow_shifts(R, self._shift(R, candidates.shifts[these]))
        return candidates.only(allowed)

    def _possible(self, judged: list[Refined]) -> list[Refined]:
        return [one for one in judged if not self.bounds.refusal(self.transform(one.fit))]

    def _judged(self, fits: Iterable[tuple[Fit, Origin]]) -> list[Refined]:
        found = list(fits)
        return self.verifier.judge(self.target, self.source, [fit for fit, _ in found], [origin for _, origin in found])

    def _verified(self, fits: Iterable[tuple[Fit, Origin]]) -> list[Verified]:
        target, source, judged = self.target, self.source, self._judged(fits)
        # the threads count points while the device correlates
        overlaps = self.pool.map(lambda one: self.verifier.overlap(target, source, one.fit), judged)
        found = [self.verifier.verify(target, source, *both) for both in zip(judged, overlaps, strict=True)]
        return sorted(found, key=lambda one: -one.score)

    def _roughly(self, candidates: Candidates, chosen: np.ndarray) -> list[tuple[Fit, Origin]]:
        """The chosen candidates, refined."""

        def rough(n: int) -> tuple[Fit, Origin]:
            return self._refine(candidates.R[n], candidates.shifts[n], _ROUGH, _ROUGH_POINTS), candidates.origin(n)

        return list(self.pool.map(rough, chosen.tolist()))

    def _refine(self, R: Rotation, shift: np.ndarray, reaches: tuple[float, ...], points: int) -> Fit:
        return refine(self.target.surface, self.source.surface, R, shift, reaches, points)
