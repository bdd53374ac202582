"""Candidates and hypotheses of a pair: shifts, evidence, missed places, and the final refinement."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import upload_poses
from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.so3 import RotationPeaks
from sonarmap.spectral.translation import Box
from sonarmap.spectral.verify.bounds import Bounds
from sonarmap.spectral.verify.fit import Fit
from sonarmap.spectral.verify.hypothesis import Evidence, Hypothesis, elsewhere, ranked
from sonarmap.spectral.verify.hypothesis_testing import (
    _SMOOTHED,
    HypothesisTest,
)
from sonarmap.spectral.verify.icp import Stage, Start
from sonarmap.spectral.verify.verifier import Selection, Verifier
from tests.samples.scenes.reliefs import above, relief, seen

SEEN = Evidence(view=0.5, coarse_view=0.5, surface=0.5, overlap=0.5, residual=1.0, width=1.0, firmness=0.1)


EDGE, VOXEL = 64, 0.5
HERE, THERE = above(-5, 3, 12), above(4.0, -6.0, 13, 25, 4, -7)
TRUE = HERE.inv() * THERE
ANYWHERE: list[Box | None] = [None]
WRONG = Rotation.from_euler("Z", 90, degrees=True) * TRUE.rotation


@pytest.fixture(scope="module")
def verifier() -> Verifier:
    return Verifier(choose_device(), EDGE)


def two_scans() -> tuple[SpectralScan, SpectralScan]:
    """Two scans whose grids' centers are 18 and -18 voxels apart."""
    registrar = SpectralRegistrar(choose_device(), Grid(EDGE, VOXEL))
    target, source = (registrar.prepare(Scan(seen(relief(1), T, 15.0))) for T in (HERE, THERE))
    return target, source


pair = pytest.fixture(scope="module")(two_scans)


def observed(
    verifier: Verifier, pair: tuple[SpectralScan, SpectralScan], hypotheses: list[Hypothesis], *most: int
) -> list[Hypothesis]:
    """The hypotheses with their evidence, in the same order."""
    fits = [hypothesis.fit for hypothesis in hypotheses]
    R = np.stack([fit.R.as_matrix() for fit in fits])
    poses = upload_poses(verifier.device, R, np.stack([fit.shift for fit in fits]))
    seen = verifier.observe(*pair, poses, *most).read()
    return [
        replace(each, evidence=e) for each, e in zip(hypotheses, seen.evidence(fits, np.zeros(len(fits))), strict=True)
    ]


def looked_at(
    verifier: Verifier, pair: tuple[SpectralScan, SpectralScan], hypotheses: list[Hypothesis]
) -> list[Hypothesis]:
    """The hypotheses with their evidence, best first."""
    return ranked(observed(verifier, pair, hypotheses))


def shift_of(pair: tuple[SpectralScan, SpectralScan]) -> np.ndarray:
    """The true one between the grids' centers [voxels]."""
    target, source = pair
    return (TRUE.apply(source.volume.center) - target.volume.center) / VOXEL


def peaks(*rotations: Rotation) -> RotationPeaks:
    return RotationPeaks(Rotation.concatenate(rotations), np.linspace(0.9, 0.1, len(rotations)))


def hypothesis(R: Rotation, shift: np.ndarray, rotation_score: float = 0.5) -> Hypothesis:
    return Hypothesis(Fit(R, shift, np.eye(6), 0.1, 100.0), rotation_score, 20.0)


class TestCandidates:
    def test_the_true_shift_is_a_candidate_of_the_true_rotation(self, verifier, pair) -> None:
        candidates = verifier.candidates(*pair, peaks(WRONG, TRUE.rotation), ANYWHERE * 2)
        off = np.linalg.norm(candidates.shifts - shift_of(pair), axis=1)
        right = np.flatnonzero(off < 2.0)
        assert (candidates.rotation_scores[right] == 0.1).all()
        assert candidates.psr[right].max() > 1.5 * candidates.psr[candidates.rotation_scores == 0.9].max()
        np.testing.assert_allclose((candidates.R[int(right[0])] * TRUE.rotation.inv()).magnitude(), 0, atol=1e-9)

    def test_the_best_candidate_is_true_and_all_are_distinct(self, verifier, pair) -> None:
        nearby = Rotation.from_rotvec([0, 0, 0.03]) * TRUE.rotation
        candidates = verifier.candidates(*pair, peaks(WRONG, nearby, TRUE.rotation), ANYWHERE * 3)
        best = verifier.best(*pair, candidates, Selection(5))
        assert len(best) == 5
        first = candidates.select(np.arange(len(candidates.psr)) == best[0])
        assert np.linalg.norm(first.shifts[0] - shift_of(pair)) < 3.0
        for n, index in enumerate(best):
            for better in best[:n]:
                apart = np.linalg.norm(candidates.shifts[index] - candidates.shifts[better])
                turned = (candidates.R[int(index)].inv() * candidates.R[int(better)]).magnitude()
                assert apart > 6.0 or turned > np.deg2rad(4.99)

    def test_a_box_bounds_the_shifts_and_resolves_cyclic_ones(self, verifier, pair) -> None:
        center = np.rint(shift_of(pair)) + np.array([2, -3, 1])
        box = Box(center, np.array([6.0, 6.0, 6.0]))
        for named in (verifier.candidates, verifier.fine_candidates):
            candidates = named(*pair, peaks(TRUE.rotation), [box])
            # a whole number of voxels of the coarse grid, and half a one besides
            assert (np.abs(candidates.shifts - center) <= 6.0 + 2.0).all()
            highest = candidates.shifts[np.argmax(candidates.psr)]
            assert np.linalg.norm(highest - shift_of(pair)) < 2.0

    def test_a_cyclic_shift_stands_for_several(self, verifier) -> None:
        """-3 is also 61, and 1 also -63, but these leave nothing in common of 64 voxels; 20 is also -44."""
        shifts = np.array([[20.0, -3.0, 1.0], [20.0, -30.0, 31.5], [50.0, -3.0, 70.0]])
        peak, unwrapped = verifier._unwrapped(shifts, np.array([False, False, True]))
        np.testing.assert_array_equal(peak, [0, 0, *[1] * 8, 2])
        np.testing.assert_array_equal(unwrapped[:2], [[20.0, -3.0, 1.0], [-44.0, -3.0, 1.0]])
        np.testing.assert_array_equal(unwrapped[-1], shifts[2])


class TestEvidence:
    def test_the_true_pose_has_better_evidence_than_a_wrong_one(self, verifier, pair) -> None:
        above_true = hypothesis(TRUE.rotation, shift_of(pair) + np.array([0, 0, 6.0]), 0.1)
        true = hypothesis(TRUE.rotation, shift_of(pair), 0.9)
        best, second = looked_at(verifier, pair, [above_true, true])
        assert best.evidence.view > 0.8 > 2 * second.evidence.view
        assert best.evidence.coarse_view > 0.8
        assert best.evidence.surface > 2 * second.evidence.surface
        assert best == replace(true, evidence=best.evidence)
        assert (best.evidence.residual, best.evidence.width) == (true.fit.residual, true.fit.width)
        assert np.isnan(best.evidence.psr)

    def test_on_the_whole_grid_only_the_true_pose_has_a_peak(self, verifier, pair) -> None:
        given = [hypothesis(TRUE.rotation, shift_of(pair)), hypothesis(WRONG, shift_of(pair))]
        right, wrong = verifier.measure(*pair, looked_at(verifier, pair, given)).read()
        assert right.fit is given[0].fit
        assert right.evidence.psr > 30 > 10 > wrong.evidence.psr
        assert right.evidence.overlap > 0.35
        assert right.score > wrong.score + 1

    def test_without_a_view_the_surfaces_are_the_evidence(self, verifier, pair) -> None:
        blind = tuple(replace(scan, view=replace(scan.view, ranges=None, viewpoints=None)) for scan in pair)
        true = hypothesis(TRUE.rotation, shift_of(pair))
        (without_view,), (with_view,) = (looked_at(verifier, each, [true]) for each in (blind, pair))
        assert np.isnan(without_view.evidence.view)
        assert without_view.evidence.consistency == without_view.evidence.surface == with_view.evidence.surface
        assert with_view.evidence.consistency == with_view.evidence.view
        candidates = verifier.candidates(*blind, peaks(WRONG, TRUE.rotation), ANYWHERE * 2)
        best = verifier.best(*blind, candidates, Selection(1))
        assert np.linalg.norm(candidates.shifts[best[0]] - shift_of(pair)) < 3.0


ASIDE = np.array([5.0, -4.0, 0.0])  # voxels


@pytest.fixture(scope="module")
def pair_test() -> HypothesisTest:
    """The test of two scans whose grids' centers are 18 and -18 voxels apart."""
    return HypothesisTest(Grid(EDGE, VOXEL), *two_scans(), Bounds(np.pi, None, VOXEL), Verifier(choose_device(), EDGE))


def true_shift(pair_test: HypothesisTest) -> np.ndarray:
    return shift_of((pair_test.target, pair_test.source))


def with_evidence(pair_test: HypothesisTest, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    return observed(pair_test.verifier, (pair_test.target, pair_test.source), hypotheses, 500)


def off(pair_test: HypothesisTest, hypothesis: Hypothesis) -> float:
    """Distance of its shift from the true one [voxels]."""
    return float(np.linalg.norm(hypothesis.fit.shift - true_shift(pair_test)))


class TestMissed:
    def test_the_true_place_is_found_if_all_finalists_are_beside_it(self, pair_test: HypothesisTest) -> None:
        beside = [hypothesis(TRUE.rotation, true_shift(pair_test) + offset) for offset in (ASIDE, -ASIDE)]
        missed = pair_test.find_missed(beside)
        assert off(pair_test, missed[0]) < 1.0
        assert len(missed) <= len(beside)

    def test_nothing_is_sought_if_planes_hold_the_best_in_all_directions(self, pair_test: HypothesisTest) -> None:
        beside = hypothesis(TRUE.rotation, true_shift(pair_test) + ASIDE)
        assert pair_test.find_missed([beside])
        assert pair_test.find_missed([replace(beside, fit=replace(beside.fit, shares=np.full(6, 0.1)))]) == []

    def test_neither_finalists_nor_poses_beyond_bounds_are_found(self, pair_test: HypothesisTest, monkeypatch) -> None:
        level = replace(pair_test, bounds=Bounds(np.deg2rad(3.0), None, VOXEL))
        for test, offset in ((pair_test, 0 * ASIDE), (level, ASIDE)):
            missed = test.find_missed([hypothesis(TRUE.rotation, true_shift(pair_test) + offset)])
            assert all(off(pair_test, each) > 2.0 for each in missed)
        monkeypatch.setattr(Bounds, "allow_shifts", lambda _bounds, _R, shifts: np.zeros(len(shifts), dtype=bool))
        assert pair_test.find_missed([hypothesis(TRUE.rotation, true_shift(pair_test))]) == []


class TestAlike:
    def known(self, pair_test: HypothesisTest, offset: np.ndarray, firmness: float) -> Hypothesis:
        """A hypothesis beside the truth that planes hold so firmly."""
        (beside,) = with_evidence(pair_test, [hypothesis(TRUE.rotation, true_shift(pair_test) + offset)])
        return replace(beside, evidence=replace(beside.evidence, firmness=firmness))

    def test_the_true_place_is_found_from_a_slid_one(self, pair_test: HypothesisTest) -> None:
        named = pair_test.find_alike([self.known(pair_test, 2 * ASIDE, 0.01)])
        assert min(off(pair_test, each) for each in named) < 1.0
        assert len(named) <= 4

    def test_nothing_is_found_if_planes_constrain_the_best_and_there_is_no_bed(
        self, pair_test: HypothesisTest, monkeypatch
    ) -> None:
        firm = self.known(pair_test, 2 * ASIDE, 0.1)
        assert pair_test.find_alike([firm])
        monkeypatch.setattr("sonarmap.spectral.verify.hypothesis_testing.is_level", lambda _surface: False)
        assert pair_test.find_alike([firm]) == []


def test_the_true_place_wins_however_the_finalists_are_ordered(pair_test: HypothesisTest) -> None:
    true, beside = (hypothesis(TRUE.rotation, true_shift(pair_test) + offset) for offset in (0 * ASIDE, 2 * ASIDE))
    for both in ([true, beside], [beside, true]):
        hypotheses = pair_test.compare(with_evidence(pair_test, both))
        assert off(pair_test, hypotheses[0]) < 1.0
        assert all(hypotheses[0].score > other.score for other in hypotheses[1:])


class TestClosest:
    """If planes constrain the best hypothesis weakly, the residual counts."""

    def compared(self, pair_test: HypothesisTest, monkeypatch: pytest.MonkeyPatch, firm: float) -> list[Hypothesis]:
        monkeypatch.setattr("sonarmap.spectral.verify.hypothesis_testing._FIRM", firm)
        monkeypatch.setattr("sonarmap.spectral.verify.hypothesis_testing._HOPELESS", 100.0)  # both stay
        both = [hypothesis(TRUE.rotation, true_shift(pair_test) + offset) for offset in (0 * ASIDE, 2 * ASIDE)]
        return pair_test.compare(with_evidence(pair_test, both))

    def test_it_counts_only_if_planes_constrain_the_best_weakly(self, pair_test: HypothesisTest, monkeypatch) -> None:
        assert [each.evidence.closeness for each in self.compared(pair_test, monkeypatch, 0.0)] == [0.0, 0.0]
        right, wrong = self.compared(pair_test, monkeypatch, 1.0)
        assert off(pair_test, right) < 0.5
        assert right.evidence.closeness > wrong.evidence.closeness > 0.0

    def test_divergence_on_smoothed_surfaces_is_undone(self, pair_test: HypothesisTest, monkeypatch) -> None:
        steps = HypothesisTest._steps

        def driven(test: HypothesisTest, start: Start, stages: list[Stage]) -> Any:
            if list(stages) != [_SMOOTHED]:
                return steps(test, start, stages)
            return steps(test, replace(start, shifts=start.shifts + 2 * ASIDE), [Stage((0.05,), 100)])

        monkeypatch.setattr(HypothesisTest, "_steps", driven)
        right = self.compared(pair_test, monkeypatch, 1.0)[0]
        assert off(pair_test, right) < 0.5
        assert right.evidence.closeness > 0.0


def test_the_best_improves_and_occurs_once(pair_test: HypothesisTest) -> None:
    rough = hypothesis(Rotation.from_rotvec([0, 0, 0.01]) * TRUE.rotation, true_shift(pair_test) + 0.8)
    first = pair_test.compare(with_evidence(pair_test, [rough]))[0]
    best, *others = pair_test.finish([first, replace(first, candidate_psr=first.candidate_psr / 2)])
    assert others == []
    assert off(pair_test, best) < min(0.3, off(pair_test, rough))
    T = pair_test.transform(best.fit)
    np.testing.assert_allclose(T.translation, TRUE.translation, atol=0.3 * VOXEL)
    assert np.rad2deg((T.rotation.inv() * TRUE.rotation).magnitude()) < 0.3


def test_moved_is_the_distance_from_the_identity(pair_test: HypothesisTest) -> None:
    """A shift counts in voxels, a turn by the displacement of points 30 voxels away."""
    centers = [scan.volume.center for scan in (pair_test.target, pair_test.source)]
    still = (centers[1] - centers[0]) / VOXEL
    turn = Rotation.from_rotvec([0, 0, 0.1])
    shifts = np.array([still, still + np.array([3.0, 0.0, -4.0]), (turn.apply(centers[1]) - centers[0]) / VOXEL])
    moved = pair_test.moved(Rotation.concatenate([Rotation.identity(2), turn]), shifts)
    np.testing.assert_allclose(moved, [0.0, 5.0, 3.0], atol=1e-4)


@pytest.mark.parametrize("spread", [0.02, 0.04, 1.0])
def test_the_best_of_hypotheses_at_the_same_pose_is_kept(spread: float) -> None:
    """Against pairwise comparison with SciPy's rotations; both signs of a quaternion are the same rotation."""
    rng = np.random.default_rng(1)
    R = Rotation.from_rotvec(rng.normal(0, spread, (40, 3)))
    turned = Rotation.from_quat(rng.choice([-1, 1], (40, 1)) * R.as_quat())
    fits = [Fit(turned[k], rng.normal(0, 50 * spread, 3), np.eye(6), 1.0, 1.0) for k in range(40)]
    best_first = [Hypothesis(fit, 1.0, psr, SEEN) for fit, psr in zip(fits, np.linspace(9, 4, 40), strict=True)]
    kept: list[Hypothesis] = []
    for each in best_first:
        away = [(each.fit.R.inv() * other.fit.R).magnitude() for other in kept]
        apart = [np.linalg.norm(each.fit.shift - other.fit.shift) for other in kept]
        if not any(turn <= np.deg2rad(3) and shift <= 2 for turn, shift in zip(away, apart, strict=True)):
            kept.append(each)
    assert ranked(best_first[::-1]) == kept
    assert elsewhere(best_first, kept) == []
