"""The hypothesis test of one pair of scans: candidates are bounded, refined and compared, and the best is finished."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import log

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.spectral.prepare.range_image import FINE
from sonarmap.spectral.so3 import RotationPeaks, distinct
from sonarmap.spectral.verify.bounds import PairFrames
from sonarmap.spectral.verify.fit import Fit
from sonarmap.spectral.verify.hypothesis import SAME_REFINED_SHIFT, Candidates, Hypothesis, elsewhere, poses, ranked
from sonarmap.spectral.verify.icp import Refined, Stage, Start, refine, start_of
from sonarmap.spectral.verify.relief import alike_places, is_level
from sonarmap.spectral.verify.verifier import SURFACE_POINTS, Selection, Verifier

# Stages of the refinement, its reaches in voxels: out of a candidate's error, a coarse voxel and 4 degrees; then twice
# to select candidates; until hypotheses can be compared; and, for the best alone, until it converges.
_FIRST = Stage((8.0, 5.0, 3.0), 100)
_QUICK = Stage((4.0, 3.0, 2.0), 250)
_ROUGH = Stage((4.0, 3.0, 2.0, 2.0), 500)
_CLOSE = Stage((4.0, 2.0, 2.0, 1.5, 1.5, 1.5), 1000)
_FINAL = Stage((1.5,) * 3, 3000)
# If a direction has less information per pair than this, the surfaces are smoothed further and refined again: the noise
# of normals of little relief inflates the Hessian and shortens steps to a twentieth. The reaches are below those at
# which rims take part.
_WEAK = 0.02
_SMOOTHED = Stage((2.0, 2.0, *(1.5,) * 6), 3000)
_DRIVEN_OFF = 0.5  # loss of agreement from which this refinement has diverged
_PROMISING = 0.4  # candidates that score less than this share of the best are not refined
_KEPT = 16  # candidates kept after the first stage
_SURVIVORS = 6  # candidates kept after the second stage
_HOPELESS = 3.5  # hypotheses whose agreement is lower than the best's by more are dropped: no peak makes up for it
# Maximum firmness of the best hypothesis at which surfaces are of little relief: other places are then sought by
# height, and compared by residual.
_FIRM = 0.05
_MIN_RESIDUAL = 0.03  # minimum residual in this comparison [voxels]
_PLACES = 12  # largest number of places found by height
_FOUND_BY_HEIGHT = Stage((4.0, 3.0, 2.0, 2.0, 2.0), 1000)  # their refinement on smoothed surfaces
_RIVALS = 4  # largest number of these to compare with the others
_SAME_ROTATION = float(np.deg2rad(1.0))  # refined rotations closer than this have the same correlation [rad]


@dataclass(frozen=True, slots=True)
class HypothesisTest(PairFrames):
    """The test of one pair of scans that share a grid, within bounds on their relative pose."""

    verifier: Verifier

    def find_candidates(self, rotations: RotationPeaks) -> Candidates:
        """Shifts of the source under each rotation, by the coarse grid and within the bounds."""
        boxes = self.boxes(rotations.R)
        return self.within_bounds(self.verifier.candidates(self.target, self.source, rotations, boxes))

    def refine_candidates(self, candidates: Candidates, count: int) -> list[Hypothesis]:
        """The best of the `count` best candidates, roughly refined, best first; if none is within the bounds, the
        others.

        On surfaces of little relief, wrong places agree nearly as well until refined, so all candidates are refined
        with few points first, and the best of these with more.
        """
        best = self.verifier.best(self.target, self.source, candidates, Selection(count, share=_PROMISING))
        first = Stage(tuple(self.verifier.coarser * reach for reach in _FIRST.reaches), _FIRST.points)
        # a single candidate needs no selection
        if len(best) == 1:
            return self._refine_candidates(candidates, best, [first, _QUICK, _ROUGH])
        kept = self._possible(self._refine_candidates(candidates, best, [first], first.points))[:_KEPT]
        if len(kept) == 1:
            return self._refine(kept, [_QUICK, _ROUGH])
        kept = self._possible(self._refine(kept, [_QUICK], _QUICK.points))[:_SURVIVORS]
        return self._possible(self._refine(kept, [_ROUGH]))

    def find_missed(self, finalists: list[Hypothesis]) -> list[Hypothesis]:
        """Further hypotheses from the whole grid's correlations under the finalists' refined rotations, at most as many
        as finalists; none if planes hold the best finalist in all directions.

        Peaks under a rotation that is 2 degrees off are low and broad: if scans can slide, as along a quay or a pool,
        the true one may be missing.
        """
        if not _has_weak_direction(finalists[0].fit):
            return []
        R = Rotation.concatenate([finalist.fit.R for finalist in finalists])
        scores = np.array([finalist.rotation_score for finalist in finalists])
        kept = distinct(R, np.arange(len(finalists)), len(finalists), _SAME_ROTATION)
        rotations, boxes = RotationPeaks(R[kept], scores[kept]), self.boxes(R[kept])
        candidates = self.within_bounds(self.verifier.fine_candidates(self.target, self.source, rotations, boxes))
        if not len(candidates.psr):
            return []
        selection = Selection(2 * len(finalists), FINE, SAME_REFINED_SHIFT)
        best = self.verifier.best(self.target, self.source, candidates, selection)
        hypotheses = self._refine_candidates(candidates, best, [_ROUGH])
        return self.possible(elsewhere(hypotheses, finalists))[: len(finalists)]

    def find_alike(self, known: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Other places and headings at which the heights of beds of little relief match.

        Over a bed the correlation prefers the identity, where the beams' lines agree, and the next ripple fits too.
        """
        surfaces, best = (self.target.surface, self.source.surface), known[0]
        weak = best.evidence.firmness <= _FIRM
        if not (weak or all(is_level(surface) for surface in surfaces)):
            return []
        places = alike_places(*surfaces, self.bounds.allow_rotations, _PLACES)
        if not len(places.alike):
            return []
        start = Start(places.R, places.shifts, np.full(len(places.alike), best.fit.width))
        free = self._unless_bounded() if weak else self
        fits = free._on_smoothed(0)._steps(start, [_FOUND_BY_HEIGHT]).read()
        rivals = free._refine_and_observe(start_of(fits), [(best.rotation_score, 0.0)] * len(fits), [_QUICK])
        return self.possible(elsewhere(ranked(rivals), known))[:_RIVALS]

    def conclude(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        """The hypotheses compared, the best first and finished; a single hypothesis is not compared."""
        hopeful = _within_margin(hypotheses, 1.5 * _HOPELESS)
        if len(hopeful) == 1:
            return self.finish(hopeful, [_CLOSE, _FINAL])
        return self.finish(self.compare(hopeful))

    def compare(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        """The hypotheses measured on the whole grid, best first, without the weaker ones at the same pose.

        All are refined by the same stages, as a better refinement would look like evidence. Over a bed of little relief
        the views agree nearly as well some voxels off, and only the residual tells. There the poses are those by the
        scans alone: errors of attitudes and depths would separate the surfaces of the true one too.
        """
        refined = self._refine(_within_margin(hypotheses, 1.5 * _HOPELESS), [_CLOSE])
        if refined[0].evidence.firmness <= _FIRM:
            close = [
                replace(each, evidence=replace(each.evidence, closeness=-log(max(each.fit.residual, _MIN_RESIDUAL))))
                for each in self._unless_bounded()._refine_smoothed(refined)
            ]
            refined = self._possible(close)
        hopeful = _within_margin(refined, _HOPELESS)
        # `finish` measures a single one
        return hopeful if len(hopeful) == 1 else self._measured(hopeful)

    def finish(self, hypotheses: list[Hypothesis], stages: Sequence[Stage] = (_FINAL,)) -> list[Hypothesis]:
        """The first and best hypothesis fully refined, and the others whose pose still differs from it."""
        best = self._with_step_to_scans(self._finish_best(hypotheses[0], stages))
        best = replace(best, evidence=replace(best.evidence, closeness=hypotheses[0].evidence.closeness))
        return [best, *elsewhere(hypotheses[1:], [best])]

    def _finish_best(self, known: Hypothesis, stages: Sequence[Stage]) -> Hypothesis:
        """The hypothesis with evidence from the scans as given, and a final pose with estimated stretches."""
        best = self._refine([known], stages)[0]
        # if closeness was compared, it was already refined on smoothed surfaces
        if not known.evidence.closeness and _has_weak_direction(best.fit):
            best = self._refine_smoothed([best])[0]
        measurement = self.verifier.measure(self.target, self.source, [best])
        (fit,) = self._steps(start_of([best.fit], stretches=True), [_FINAL]).read()
        return replace(measurement.read()[0], fit=fit)

    def _refine_smoothed(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Hypotheses refined on smoothed surfaces, the smoothest first, then on the plain surfaces; on these alone
        if the refinement diverges on the smoothed ones, which may constrain nothing without rims."""
        fits: Sequence[Fit] = [each.fit for each in hypotheses]
        for level in range(len(self.target.smoother())):
            fits = self._on_smoothed(level)._steps(start_of(fits), [_SMOOTHED]).read()
        laid = self._refine_and_observe(start_of(fits), _origins(hypotheses), [_FINAL])
        kept: list[Hypothesis] = []
        driven: list[Hypothesis] = []
        for new, old in zip(laid, hypotheses, strict=True):
            if new.evidence.agreement >= old.evidence.agreement - _DRIVEN_OFF:
                kept.append(new)
            else:
                driven.append(old)
        return ranked([*kept, *(self._refine(driven, [_FINAL]) if driven else [])])

    def _without_instruments(self) -> "HypothesisTest":
        return replace(self, bounds=replace(self.bounds, prior=None))

    def _unless_bounded(self) -> "HypothesisTest":
        """The test by the scans alone, unless instruments bound the place: on a flat bed nothing else constrains it."""
        return self if self.bounds.shift_box(Rotation.identity()) else self._without_instruments()

    def _on_smoothed(self, level: int) -> "HypothesisTest":
        """The test on the scans' smoothed surfaces; level 0 is the smoothest."""
        target, source = (replace(scan, surface=scan.smoother()[level]) for scan in (self.target, self.source))
        return replace(self, target=target, source=source)

    def _with_step_to_scans(self, best: Hypothesis) -> Hypothesis:
        """The hypothesis with the whole step from its pose to that by the scans alone, if instruments took part: points
        were paired at the common pose, so a single step from there falls short."""
        fit = best.fit
        if fit.prior is None:
            return best
        free = self._without_instruments()
        (alone,) = free._steps(start_of([fit.by_scans]), [_CLOSE]).read()
        if _has_weak_direction(alone):
            alone = free._refine_smoothed([replace(best, fit=alone)])[0].fit
        (alone,) = free._steps(start_of([alone], stretches=True), [_FINAL]).read()
        step = np.concatenate([(alone.R * fit.R.inv()).as_rotvec(), alone.shift - fit.shift])
        return replace(best, fit=replace(fit, step=step))

    def _measured(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        measured = self.verifier.measure(self.target, self.source, hypotheses).read()
        return sorted(measured, key=lambda hypothesis: -hypothesis.score)

    def _possible(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        """Hypotheses within the bounds, or all if there are none."""
        return self.possible(hypotheses) or hypotheses

    def _refine_candidates(
        self, candidates: Candidates, chosen: np.ndarray, stages: Sequence[Stage], points: int = SURFACE_POINTS
    ) -> list[Hypothesis]:
        start = Start(candidates.R[chosen], candidates.shifts[chosen], np.zeros(len(chosen)))
        origins = np.column_stack([candidates.rotation_scores, candidates.psr])[chosen].tolist()
        return ranked(self._refine_and_observe(start, origins, stages, points))

    def _refine(
        self, hypotheses: Sequence[Hypothesis], stages: Sequence[Stage], points: int = SURFACE_POINTS
    ) -> list[Hypothesis]:
        start = start_of([each.fit for each in hypotheses])
        return ranked(self._refine_and_observe(start, _origins(hypotheses), stages, points))

    def _refine_and_observe(
        self,
        start: Start,
        origins: Sequence[Sequence[float]],
        stages: Sequence[Stage],
        points: int = SURFACE_POINTS,
    ) -> list[Hypothesis]:
        """Refined hypotheses, observed with `points` points; waits once for the device.
        `origins` are `Hypothesis.rotation_score` and `candidate_psr` of each."""
        refined = self._steps(start, stages)
        seen = self.verifier.observe(self.target, self.source, refined.poses, points).read()
        fits = refined.read()
        rows = zip(fits, origins, seen.evidence(fits, self.moved(*poses(fits))), strict=True)
        return [Hypothesis(fit, score, psr, shown) for fit, (score, psr), shown in rows]

    def _steps(self, start: Start, stages: Sequence[Stage]) -> Refined:
        """Queue the refinement of all poses."""
        prior = self.bounds.prior
        prior_at = partial(self.prior_at, prior) if prior is not None and prior.measures else None
        return refine(self.verifier.device, self.target.surface, self.source.surface, start, stages, prior_at)


def _origins(hypotheses: Sequence[Hypothesis]) -> list[tuple[float, float]]:
    return [(each.rotation_score, each.candidate_psr) for each in hypotheses]


def _has_weak_direction(fit: Fit) -> bool:
    """Whether a direction has so little information that the noise of normals shortens its steps."""
    return bool(fit.shares[0] < _WEAK)


def _within_margin(hypotheses: Sequence[Hypothesis], margin: float) -> list[Hypothesis]:
    """Hypotheses whose agreement is within the margin of the best."""
    least = max(hypothesis.evidence.agreement for hypothesis in hypotheses) - margin
    return [hypothesis for hypothesis in hypotheses if hypothesis.evidence.agreement >= least]
