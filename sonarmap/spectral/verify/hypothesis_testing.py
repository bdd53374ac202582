"""The hypotheses about one pair of scans: bounded, refined, compared, and the best refined to the end."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.spectral.prepare.range_image import FINE
from sonarmap.spectral.so3 import RotationPeaks, distinct
from sonarmap.spectral.verify.bounds import PairFrames
from sonarmap.spectral.verify.fit import Fit, principal_axes
from sonarmap.spectral.verify.hypothesis import SAME_REFINED_SHIFT, Candidates, Hypothesis, elsewhere, ranked
from sonarmap.spectral.verify.icp import Refined, Stage, Start, refine
from sonarmap.spectral.verify.relief import alike_places, is_level
from sonarmap.spectral.verify.verifier import SURFACE_POINTS, Selection, Verifier

# Reaches of the refinement's steps [voxels] and its points: out of a candidate's error, which a coarse voxel and a
# rotation 4 degrees off make; twice until it shows which candidates are worth more; until hypotheses can be compared;
# and, for the best alone, on to the end.
_FIRST = Stage((8.0, 5.0, 3.0), 100)
_QUICK = Stage((4.0, 3.0, 2.0), 250)
_ROUGH = Stage((4.0, 3.0, 2.0, 2.0), 500)
_CLOSE = Stage((4.0, 2.0, 2.0, 1.5, 1.5, 1.5), 1000)
_FINAL = Stage((1.5,) * 3, 3000)
# Where one direction is held by less than this share of the planes, surfaces are laid on each other once more, smoothed
# further: normals of little relief are mostly noise, which adds to the squares that a step is divided by, so that it
# covers a twentieth of its way. No step reaches so far that rims take part.
_LOOSE = 0.02
_SMOOTHED = Stage((2.0, 2.0, *(1.5,) * 6), 3000)
_DRIVEN_OFF = 0.5  # a hypothesis that agrees less by more than this then was driven off
_PROMISING = 0.4  # candidates that score less than this share of the best are not refined
_LEFT = 16  # candidates after the first steps
_SURVIVORS = 6  # and after the next
_HOPELESS = 3.5  # hypotheses whose agreement is less than the best's by more are out: no peak makes up for it
# Planes hold the best less firmly than this where surfaces are laid upon each other beside it, and where how close they
# come counts most: where planes hold it more firmly, nothing came of that.
_FIRM = 0.05
_CLOSEST = 0.03  # surfaces whose residual is smaller are as close as any [voxels]
_PLACES = 12  # that heights name there, and over beds
_SLID = Stage((4.0, 3.0, 2.0, 2.0, 2.0), 1000)  # by which these are laid upon each other smoothly
_RIVALS = 4  # of these that are compared with the others
_SAME_ROTATION = float(np.deg2rad(1.0))  # refined rotations nearer than this have the same correlation [rad]


@dataclass(frozen=True, slots=True)
class HypothesisTest(PairFrames):
    """One pair of scans on a grid that both share, and which poses are possible between them."""

    verifier: Verifier

    def find_candidates(self, rotations: RotationPeaks) -> Candidates:
        """Where the scan would lie under each of the rotations, by the coarse grid; possible places only."""
        boxes = [self.box(R) for R in rotations.R]
        return self.within_bounds(self.verifier.candidates(self.target, self.source, rotations, boxes))

    def refine_candidates(self, candidates: Candidates, count: int) -> list[Hypothesis]:
        """The best of the `count` best candidates, refined roughly, best first; impossible ones only where there are no
        others.

        Surfaces of little relief agree nearly as well at wrong places, until a candidate is refined: so many are
        refined by few points, and the best of these by more.
        """
        best = self.verifier.best(self.target, self.source, candidates, Selection(count, share=_PROMISING))
        first = Stage(tuple(self.verifier.coarser * reach for reach in _FIRST.reaches), _FIRST.points)
        # one that is left alone goes on at once
        if len(best) == 1:
            return self._refine_candidates(candidates, best, [first, _QUICK, _ROUGH])
        left = self._possible(self._refine_candidates(candidates, best, [first], first.points))[:_LEFT]
        if len(left) == 1:
            return self._refine(left, [_QUICK, _ROUGH])
        left = self._possible(self._refine(left, [_QUICK], _QUICK.points))[:_SURVIVORS]
        return self._possible(self._refine(left, [_ROUGH]))

    def find_missed(self, finalists: list[Hypothesis]) -> list[Hypothesis]:
        """What the whole grid's correlations under the finalists' refined rotations name beside the finalists, as many
        at most.

        A rotation that is 2 degrees off has low and broad peaks: where a scan can slide, along a quay or a pool, the
        true one may be missing.
        """
        R = Rotation.concatenate([finalist.fit.R for finalist in finalists])
        scores = np.array([finalist.rotation_score for finalist in finalists])
        kept = distinct(R, np.arange(len(finalists)), len(finalists), _SAME_ROTATION)
        rotations, boxes = RotationPeaks(R[kept], scores[kept]), [self.box(each) for each in R[kept]]
        named = self.verifier.fine_candidates(self.target, self.source, rotations, boxes)
        candidates = self.within_bounds(named)
        if not len(candidates.psr):
            return []
        selection = Selection(2 * len(finalists), FINE, SAME_REFINED_SHIFT)
        best = self.verifier.best(self.target, self.source, candidates, selection)
        hypotheses = self._refine_candidates(candidates, best, [_ROUGH])
        return self.possible(elsewhere(hypotheses, finalists))[: len(finalists)]

    def find_alike(self, known: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Other places at which the heights of beds of little relief are alike, whichever way the source is turned.

        Over a bed the lines that beams draw agree best where nothing has moved, and the ripples do at the next one.
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
        fits = free._smoother(0)._steps(start, [_SLID]).read()
        rivals = free._round(_start(fits), [(best.rotation_score, 0.0)] * len(fits), [_QUICK], SURFACE_POINTS)
        return self.possible(elsewhere(rivals, known))[:_RIVALS]

    def conclude(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        """The hypotheses compared, and the best refined to the end as `finish` does; one alone is not compared."""
        hopeful = _hopeful(hypotheses, 1.5 * _HOPELESS)
        if len(hopeful) == 1:
            return self.finish(hopeful, [_CLOSE, _FINAL])
        return self.finish(self.compare(hopeful))

    def compare(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        """Measured on the whole grid, best first, of those at the same pose the best alone; all refined alike, as an
        advantage in that would look like evidence.

        Over a bed of little relief, what the sensors saw agrees nearly as well some voxels off, where the surfaces are
        a little farther apart. There all are where the scans alone would have them: attitudes and depths move them by
        their own errors, and part the surfaces of the true one as well.
        """
        refined = self._refine(_hopeful(hypotheses, 1.5 * _HOPELESS), [_CLOSE])
        if refined[0].evidence.firmness <= _FIRM:
            close = [
                replace(each, evidence=replace(each.evidence, closeness=-log(max(each.fit.residual, _CLOSEST))))
                for each in self._unless_bounded()._laid_smoothly(refined)
            ]
            refined = self._possible(close)
        hopeful = _hopeful(refined, _HOPELESS)
        # one alone is measured where it ends
        return hopeful if len(hopeful) == 1 else self._measured(hopeful)

    def finish(self, hypotheses: list[Hypothesis], stages: Sequence[Stage] = (_FINAL,)) -> list[Hypothesis]:
        """The first and best hypothesis refined to the end, and the others that are not now where it is."""
        best = self._left_to_scans(self._finish_best(hypotheses[0], stages))
        best = replace(best, evidence=replace(best.evidence, closeness=hypotheses[0].evidence.closeness))
        return [best, *elsewhere(hypotheses[1:], [best])]

    def _finish_best(self, known: Hypothesis, stages: Sequence[Stage]) -> Hypothesis:
        """Its evidence is of the scans as they are; its pose, by planes, is with their ranges set right."""
        best = self._refine([known], stages)[0]
        # where closeness was compared, it has been laid smoothly before
        if not known.evidence.closeness and _loose(best.fit):
            best = self._laid_smoothly([best])[0]
        measurement = self.verifier.measure(self.target, self.source, [best])
        (fit,) = self._steps(_start([best.fit], stretches=True), [_FINAL]).read()
        return replace(measurement.read()[0], fit=fit)

    def _laid_smoothly(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Refined by surfaces that are smoothed further, the smoothest first, and then by the surfaces as they are; by
        these alone where the smoother ones, which may hold nothing without rims, drive a hypothesis off."""
        fits: Sequence[Fit] = [each.fit for each in hypotheses]
        for level in range(len(self.target.smoother())):
            fits = self._smoother(level)._steps(_start(fits), [_SMOOTHED]).read()
        laid = self._observed(_start(fits), _origins(hypotheses), [_FINAL])
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
        """The same by the scans alone, unless instruments bound the place: on a flat bed nothing else holds it."""
        return self if self.box(Rotation.identity()) else self._without_instruments()

    def _smoother(self, level: int) -> "HypothesisTest":
        """The same of the scans' surfaces smoothed further, 0 the smoothest."""
        target, source = (replace(scan, surface=scan.smoother()[level]) for scan in (self.target, self.source))
        return replace(self, target=target, source=source)

    def _left_to_scans(self, best: Hypothesis) -> Hypothesis:
        """The hypothesis with the whole step to where the scans alone would have it, where instruments took part:
        beside them points pair up where these have the pose, and one step from there falls short."""
        fit = best.fit
        if fit.prior is None:
            return best
        free = self._without_instruments()
        (alone,) = free._steps(_start([fit.by_scans]), [_CLOSE]).read()
        if _loose(alone):
            alone = free._laid_smoothly([replace(best, fit=alone)])[0].fit
        (alone,) = free._steps(_start([alone], stretches=True), [_FINAL]).read()
        step = np.concatenate([(alone.R * fit.R.inv()).as_rotvec(), alone.shift - fit.shift])
        return replace(best, fit=replace(fit, step=step))

    def _measured(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        measured = self.verifier.measure(self.target, self.source, hypotheses).read()
        return sorted(measured, key=lambda hypothesis: -hypothesis.score)

    def _possible(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        """The possible ones; all where none is."""
        return self.possible(hypotheses) or hypotheses

    def _refine_candidates(
        self, candidates: Candidates, chosen: np.ndarray, stages: Sequence[Stage], points: int = SURFACE_POINTS
    ) -> list[Hypothesis]:
        R, shifts = candidates.R[chosen], candidates.shifts[chosen]
        scores, psr = candidates.rotation_scores[chosen].tolist(), candidates.psr[chosen].tolist()
        start = Start(R, shifts, np.zeros(len(shifts)))
        return self._round(start, list(zip(scores, psr, strict=True)), stages, points)

    def _refine(
        self, hypotheses: Sequence[Hypothesis], stages: Sequence[Stage], points: int = SURFACE_POINTS
    ) -> list[Hypothesis]:
        return self._round(_start([each.fit for each in hypotheses]), _origins(hypotheses), stages, points)

    def _round(
        self, start: Start, origins: Sequence[tuple[float, float]], stages: Sequence[Stage], points: int
    ) -> list[Hypothesis]:
        """As `_observed`, best first; of those that come out at the same pose the best alone."""
        return ranked(self._observed(start, origins, stages, points))

    def _observed(
        self,
        start: Start,
        origins: Sequence[tuple[float, float]],
        stages: Sequence[Stage],
        points: int = SURFACE_POINTS,
    ) -> list[Hypothesis]:
        """Refined, and observed by so many points; one wait unless instruments take part. `origins` are scores of the
        rotations and peaks of the candidates, as `Hypothesis` has them."""
        refined = self._steps(start, stages)
        seen = self.verifier.observe(self.target, self.source, refined.poses, points).read()
        fits = refined.read()
        rows = zip(fits, origins, seen.evidence(fits), strict=True)
        return [Hypothesis(fit, *origin, replace(shown, moved=self.moved(fit))) for fit, origin, shown in rows]

    def _steps(self, start: Start, stages: Sequence[Stage]) -> Refined:
        """Queue the refinement from each of the places."""
        scans = self.verifier.device, self.target.surface, self.source.surface
        if self.bounds.prior is None:
            return refine(*scans, start, stages)
        # what instruments measured is linear about where a stage begins
        *before, last = stages
        for stage in before:
            prior = self.prior_at(start.R, start.shifts, start.stretches)
            start = _start(refine(*scans, start, [stage], prior).read(), start.stretches)
        return refine(*scans, start, [last], self.prior_at(start.R, start.shifts, start.stretches))


def _start(fits: Sequence[Fit], stretches: bool = False) -> Start:
    shifts, widths = np.array([fit.shift for fit in fits]), np.array([fit.width for fit in fits])
    return Start(Rotation.concatenate([fit.R for fit in fits]), shifts, widths, stretches)


def _origins(hypotheses: Sequence[Hypothesis]) -> list[tuple[float, float]]:
    return [(each.rotation_score, each.candidate_psr) for each in hypotheses]


def _loose(fit: Fit) -> bool:
    """Whether one direction is held so little that noise of normals would shorten its steps."""
    return bool(principal_axes(fit.information, fit.pairs)[0][0] < _LOOSE)


def _hopeful(hypotheses: Sequence[Hypothesis], margin: float) -> list[Hypothesis]:
    """Those whose agreement is not less than the best's by more than the margin."""
    least = max(hypothesis.evidence.agreement for hypothesis in hypotheses) - margin
    return [hypothesis for hypothesis in hypotheses if hypothesis.evidence.agreement >= least]
