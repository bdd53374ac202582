"""The hypotheses of a pair, compared: what the finalists lack, and how the best is refined to the end."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.kernels.points.poses import upload_poses
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.verify.bounds import Bounds
from sonarmap.spectral.verify.fit import Fit
from sonarmap.spectral.verify.hypothesis import Hypothesis
from sonarmap.spectral.verify.hypothesis_testing import HypothesisTest
from sonarmap.spectral.verify.verifier import Verifier
from tests.samples.reliefs import above, relief, seen

EDGE, VOXEL = 64, 0.5
HERE, THERE = above(-5, 3, 12), above(4.0, -6.0, 13, 25, 4, -7)
TRUE = HERE.inv() * THERE
ASIDE = np.array([5.0, -4.0, 0.0])  # voxels


@pytest.fixture(scope="module")
def pair_test() -> HypothesisTest:
    """Of two scans whose grids' centers lie 18 and -18 voxels apart."""
    device, grid = choose_device(), Grid(EDGE, VOXEL)
    registrar = SpectralRegistrar(device, grid)
    target, source = (registrar.prepare(Scan(seen(relief(1), T, 15.0))) for T in (HERE, THERE))
    return HypothesisTest(Verifier(device, EDGE), grid, target, source, Bounds(np.pi, None, VOXEL))


def true_shift(pair_test: HypothesisTest) -> np.ndarray:
    """Between the grids' centers [voxels]."""
    return (TRUE.apply(pair_test.source.volume.center) - pair_test.target.volume.center) / VOXEL


def refined(R: Rotation, shift: np.ndarray) -> Hypothesis:
    return Hypothesis(Fit(R, shift, np.eye(6), 0.1, 100.0), 0.5, 20.0)


def looked_at(pair_test: HypothesisTest, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    """The same with what the scans saw, in the same order."""
    fits = [hypothesis.fit for hypothesis in hypotheses]
    R = np.stack([fit.R.as_matrix() for fit in fits])
    poses = upload_poses(pair_test.verifier.device, R, np.stack([fit.shift for fit in fits]))
    seen = pair_test.verifier.observe(pair_test.target, pair_test.source, poses, 500).read()
    return [replace(hypothesis, evidence=e) for hypothesis, e in zip(hypotheses, seen.evidence(fits), strict=True)]


def off(pair_test: HypothesisTest, hypothesis: Hypothesis) -> float:
    """How far its shift is from the true one [voxels]."""
    return float(np.linalg.norm(hypothesis.fit.shift - true_shift(pair_test)))


class TestMissed:
    def test_the_true_place_is_named_where_all_finalists_lie_beside_it(self, pair_test: HypothesisTest) -> None:
        beside = [refined(TRUE.rotation, true_shift(pair_test) + offset) for offset in (ASIDE, -ASIDE)]
        missed = pair_test.find_missed(beside)
        assert off(pair_test, missed[0]) < 1.0
        assert len(missed) <= len(beside)

    def test_what_is_a_finalist_is_not_named_again(self, pair_test: HypothesisTest) -> None:
        missed = pair_test.find_missed([refined(TRUE.rotation, true_shift(pair_test))])
        assert all(off(pair_test, hypothesis) > 2.0 for hypothesis in missed)

    def test_what_the_bounds_forbid_is_not_named(self, pair_test: HypothesisTest) -> None:
        level = replace(pair_test, bounds=Bounds(np.deg2rad(3.0), None, VOXEL))
        missed = level.find_missed([refined(TRUE.rotation, true_shift(pair_test) + ASIDE)])
        assert all(off(pair_test, hypothesis) > 2.0 for hypothesis in missed)

    def test_nothing_is_named_where_no_shift_may_be_meant(self, pair_test: HypothesisTest, monkeypatch) -> None:
        monkeypatch.setattr(Bounds, "allow_shifts", lambda _bounds, _R, shifts: np.zeros(len(shifts), dtype=bool))
        assert pair_test.find_missed([refined(TRUE.rotation, true_shift(pair_test))]) == []


def test_the_true_place_wins_however_the_finalists_are_ordered(pair_test: HypothesisTest) -> None:
    true, beside = (
        refined(TRUE.rotation, true_shift(pair_test)),
        refined(TRUE.rotation, true_shift(pair_test) + 2 * ASIDE),
    )
    for both in ([true, beside], [beside, true]):
        hypotheses = pair_test.compare(looked_at(pair_test, both))
        assert off(pair_test, hypotheses[0]) < 1.0
        assert all(hypotheses[0].score > other.score for other in hypotheses[1:])


def test_what_looks_hopeless_is_not_compared(pair_test: HypothesisTest, monkeypatch: pytest.MonkeyPatch) -> None:
    true, beside = looked_at(
        pair_test,
        [refined(TRUE.rotation, true_shift(pair_test)), refined(TRUE.rotation, true_shift(pair_test) + 2 * ASIDE)],
    )
    refined_again: list[int] = []
    refine = HypothesisTest._refine

    def counted(test: HypothesisTest, hypotheses: list[Hypothesis], *rest: Any) -> list[Hypothesis]:
        refined_again.append(len(hypotheses))
        return refine(test, hypotheses, *rest)

    monkeypatch.setattr(HypothesisTest, "_refine", counted)
    pair_test.compare([true, beside])
    hopeless = replace(beside, evidence=replace(beside.evidence, width=50.0))
    (only,) = pair_test.compare([hopeless, true])
    assert refined_again == [2, 1]
    assert off(pair_test, only) < 1.0


def test_the_best_ends_nearer_and_stands_once(pair_test: HypothesisTest) -> None:
    rough = refined(Rotation.from_rotvec([0, 0, 0.01]) * TRUE.rotation, true_shift(pair_test) + 0.8)
    first = pair_test.compare(looked_at(pair_test, [rough]))[0]
    best, *others = pair_test.finish([first, replace(first, candidate_psr=first.candidate_psr / 2)], spectral=False)
    assert others == []
    assert off(pair_test, best) < min(0.3, off(pair_test, rough))
    T = pair_test.transform(best.fit)
    np.testing.assert_allclose(T.translation, TRUE.translation, atol=0.3 * VOXEL)
    assert np.rad2deg((T.rotation.inv() * TRUE.rotation).magnitude()) < 0.3
