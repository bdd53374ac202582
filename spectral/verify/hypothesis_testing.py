"""The hypotheses about one pair of scans: bounded, refined, compared, and the best refined to the end."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from spectral.covariance import cross_matrices
from spectral.grid import Grid
from spectral.prepare.range_image import FINE
from spectral.prepare.spectral_scan import SpectralScan
from spectral.rotation_search import search_rotation
from spectral.so3 import RotationPeaks
from spectral.translation import Box
from spectral.verify.bounds import Bounds
from spectral.verify.calibration import CALIBRATION
from spectral.verify.candidates import Candidates
from spectral.verify.fit import Fit
from spectral.verify.hypothesis import SAME_REFINED_SHIFT, Hypothesis, alike
from spectral.verify.icp import Start, refine
from spectral.verify.prior_term import PriorTerm
from spectral.verify.verifier import SURFACE_POINTS, Verifier

# Reaches of the refinement's steps [voxels] and its points: out of a candidate's error, which a coarse voxel and a
# rotation 4 degrees off make; twice until it shows which candidates are worth more; until hypotheses can be compared;
# and, for the best alone, on to the end.
_FIRST, _FIRST_POINTS = (8.0, 5.0, 3.0), 100
_QUICK, _QUICK_POINTS = (4.0, 3.0, 2.0), 250
_ROUGH, _ROUGH_POINTS = (4.0, 3.0, 2.0, 2.0), 500
_CLOSE, _CLOSE_POINTS = (4.0, 2.0, 2.0, 1.5, 1.5, 1.5), 1000
_FINAL, _FINAL_POINTS = (1.5,) * 3, 3000
# Candidates that score less than this share of the best are not refined: of 115 right ones among the best 72 one scored
# less than half.
_PROMISING = 0.4
# So many of the candidates are left after the first steps, and after the next.
_LEFT, _SURVIVORS = 16, 6
# Hypotheses whose looks are less than the best's by more than this are out: no peak makes up for it.
_HOPELESS = 3.5
# Refined rotations nearer than this have the same correlation on the whole grid [rad].
_SAME_ROTATION = float(np.deg2rad(1.0))


@dataclass(frozen=True, slots=True)
class HypothesisTest:
    """One pair of scans, and which poses are possible between them.

    Attributes:
        verifier: of the grid.
        grid: that both scans share.
        target, source: the scans.
        bounds: which poses are possible.
    """

    verifier: Verifier
    grid: Grid
    target: SpectralScan
    source: SpectralScan
    bounds: Bounds

    def find_candidates(self, rotations: RotationPeaks) -> Candidates:
        """Where the scan would lie under each of the rotations, by the coarse grid; possible places only."""
        boxes = [self._box(R) for R in rotations.R]
        return self._within_bounds(self.verifier.candidates(self.target, self.source, rotations, boxes))

    def refine_candidates(self, candidates: Candidates, count: int) -> list[Hypothesis]:
        """The best of the `count` best candidates, refined roughly, best first.

        Surfaces of little relief agree nearly as well at wrong places, until a candidate is refined: so many are
        refined by few points, and the best of these by more. Impossible ones are kept only where there are no others.
        """
        best = self.verifier.best(self.target, self.source, candidates, count, share=_PROMISING)
        reaches = tuple(self.verifier.coarser * reach for reach in _FIRST)
        hypotheses = self._ranked(self._refine_candidates(candidates, best, reaches, _FIRST_POINTS), _FIRST_POINTS)
        quick = self._refine_all(hypotheses[:_LEFT], _QUICK, _QUICK_POINTS)
        survivors = self._ranked(quick, _QUICK_POINTS)[:_SURVIVORS]
        return self._ranked(self._refine_all(survivors, _ROUGH, _ROUGH_POINTS))

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
        boxes = [self._box(finalist.fit.R) for finalist in distinct]
        candidates = self._within_bounds(self.verifier.fine_candidates(self.target, self.source, rotations, boxes))
        if not len(candidates.psr):
            return []
        count = 2 * len(finalists)
        best = self.verifier.best(self.target, self.source, candidates, count, FINE, SAME_REFINED_SHIFT)
        hypotheses = self._refine_candidates(candidates, best, _ROUGH, _ROUGH_POINTS)
        missed = [new for new in hypotheses if not any(alike(new.fit, finalist.fit) for finalist in finalists)]
        return self._possible(self._rank(missed))[: len(finalists)] if missed else []

    def compare(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        """Measured on the whole grid, best first; all refined alike, as an advantage in that would look like evidence.

        Of those that came out at the same pose the best alone is kept.
        """
        hopeful = _hopeful(hypotheses, 1.5 * _HOPELESS)
        return self._measure(self._refine_all(hopeful, _CLOSE, _CLOSE_POINTS))

    def finish(self, hypotheses: list[Hypothesis], spectral: bool) -> list[Hypothesis]:
        """The best hypothesis refined to the end, and the others that are not now where it is.

        Args:
            hypotheses: best first.
            spectral: whether the best climbs the translation's peak over the rotation, instead of the planes.
        """
        best = self._left_to_scans(self._finish_best(hypotheses[0], spectral))
        return [best, *(hypothesis for hypothesis in hypotheses[1:] if not alike(hypothesis.fit, best.fit))]

    def transform(self, fit: Fit) -> RigidTransform:
        """T_target_source between the sensor frames [m]."""
        return RigidTransform.from_components(self._sensor_shift(fit.R, fit.shift), fit.R)

    def _finish_best(self, best: Hypothesis, spectral: bool) -> Hypothesis:
        """Its evidence is of the scans as they are; its pose, by planes, is with their ranges set right."""
        best = self._refine_all([best], _FINAL, _FINAL_POINTS)[0]
        if not spectral:
            return self._refine_all(self._measure([best]), _FINAL, _FINAL_POINTS, stretches=True)[0]
        translation, target, source = self.verifier.translation, self.target.volume, self.source.volume
        begin = Rotation.concatenate([best.fit.R])
        peak = translation.find_at(target, source, begin, best.fit.shift[None]).highest()[0]
        R, peak = search_rotation(translation, target, source, best.fit.R, peak, stay=True)
        near = peak.shift + self.grid.edge * np.rint((best.fit.shift - peak.shift) / self.grid.edge)
        return self._measure([replace(best, fit=replace(best.fit, R=R, shift=near))])[0]

    def _left_to_scans(self, best: Hypothesis) -> Hypothesis:
        """The hypothesis with the whole step to where the scans alone would have it, where instruments took part.

        Beside instruments points pair up where these have the pose, and one step from there falls short: a graph that
        holds the instruments as well would count their errors twice.
        """
        fit = best.fit
        if fit.prior is None:
            return best
        alone = fit.by_scans
        for reaches, points, stretches in ((_CLOSE, _CLOSE_POINTS, False), (_FINAL, _FINAL_POINTS, True)):
            begin = Start(Rotation.concatenate([alone.R]), alone.shift[None], np.array([alone.width]))
            alone = refine(
                self.verifier.device,
                self.target.surface,
                self.source.surface,
                begin,
                reaches,
                points,
                stretches=stretches,
            )[0]
        step = np.concatenate([(alone.R * fit.R.inv()).as_rotvec(), alone.shift - fit.shift])
        return replace(best, fit=replace(fit, step=step))

    def _sensor_shift(self, R: Rotation, shift: np.ndarray) -> np.ndarray:
        """Where the source's sensor is in the target's frame (..., 3) [m], from shifts between the grids [voxels]."""
        return self.target.volume.center + shift * self.grid.voxel - R.apply(self.source.volume.center)

    def _box(self, R: Rotation) -> Box | None:
        """The shifts between the grids' centers that position and depth leave [voxels]; None for all."""
        box = self.bounds.shift_box(R)
        if box is None:
            return None
        center = (box[0] - self.target.volume.center + R.apply(self.source.volume.center)) / self.grid.voxel
        return Box(np.rint(center), box[1] / self.grid.voxel)

    def _within_bounds(self, candidates: Candidates) -> Candidates:
        """Those whose shift is possible."""
        allowed = np.zeros(len(candidates.psr), dtype=bool)
        for rotation in np.unique(candidates.rotation):
            indices = np.flatnonzero(candidates.rotation == rotation)
            R = candidates.R[int(indices[0])]
            allowed[indices] = self.bounds.allow_shifts(R, self._sensor_shift(R, candidates.shifts[indices]))
        return candidates.select(allowed)

    def _possible(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Those within the bounds."""
        if not hypotheses:
            return []
        fits = [hypothesis.fit for hypothesis in hypotheses]
        allowed = self.bounds.allow_rotations(Rotation.concatenate([fit.R for fit in fits]))
        return [
            hypothesis
            for hypothesis, fit, turned in zip(hypotheses, fits, allowed, strict=True)
            if turned and self.bounds.allow_shifts(fit.R, self._sensor_shift(fit.R, fit.shift)[None])[0]
        ]

    def _rank(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        return self.verifier.rank(self.target, self.source, hypotheses)

    def _ranked(self, hypotheses: Sequence[Hypothesis], points: int = SURFACE_POINTS) -> list[Hypothesis]:
        """The possible ones, best first, by so many points of their surfaces; all where none is possible."""
        ranked = self.verifier.rank(self.target, self.source, hypotheses, points)
        return self._possible(ranked) or ranked

    def _measure(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Distinct hypotheses with all their evidence, best first."""
        hopeful = _hopeful(self._rank(hypotheses), _HOPELESS)
        measured = self.verifier.measure(self.target, self.source, hopeful)
        return sorted(measured, key=lambda hypothesis: -hypothesis.score)

    def _refine_candidates(
        self, candidates: Candidates, chosen: np.ndarray, reaches: tuple[float, ...], points: int
    ) -> list[Hypothesis]:
        """The chosen candidates, refined."""
        R = candidates.R[chosen]  # pyright: ignore[reportArgumentType]
        fits = self._refine(R, candidates.shifts[chosen], reaches, points)
        scores, psr = candidates.rotation_scores[chosen].tolist(), candidates.psr[chosen].tolist()
        return [Hypothesis(*each) for each in zip(fits, scores, psr, strict=True)]

    def _refine_all(
        self, hypotheses: Sequence[Hypothesis], reaches: tuple[float, ...], points: int, stretches: bool = False
    ) -> list[Hypothesis]:
        """The hypotheses, refined further."""
        if not hypotheses:
            return []
        R = Rotation.concatenate([hypothesis.fit.R for hypothesis in hypotheses])
        shifts = np.array([hypothesis.fit.shift for hypothesis in hypotheses])
        widths = [hypothesis.fit.width for hypothesis in hypotheses]
        fits = self._refine(R, shifts, reaches, points, widths, stretches)
        return [replace(hypothesis, fit=fit) for hypothesis, fit in zip(hypotheses, fits, strict=True)]

    def _refine(
        self,
        R: Rotation,
        shifts: np.ndarray,
        reaches: tuple[float, ...],
        points: int,
        widths: Sequence[float] | None = None,
        stretches: bool = False,
    ) -> list[Fit]:
        """From each of the places, (k,) rotations and (k, 3) shifts."""
        begin = Start(R, shifts, np.zeros(len(shifts)) if widths is None else np.array(widths))
        prior = self._prior_at(R, shifts, stretches)
        return refine(
            self.verifier.device, self.target.surface, self.source.surface, begin, reaches, points, prior, stretches
        )

    def _prior_at(self, R: Rotation, shifts: np.ndarray, stretches: bool) -> PriorTerm | None:
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


def _hopeful(hypotheses: Sequence[Hypothesis], margin: float) -> list[Hypothesis]:
    """Those whose looks are not less than the best's by more than the margin."""
    least = max(hypothesis.evidence.looks for hypothesis in hypotheses) - margin
    return [hypothesis for hypothesis in hypotheses if hypothesis.evidence.looks >= least]
