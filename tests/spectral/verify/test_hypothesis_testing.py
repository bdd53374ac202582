"""The hypotheses of a pair, compared: what the finalists lack, and how the best is refined to the end."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.verify.bounds import Bounds
from sonarmap.spectral.verify.hypothesis import Hypothesis
from sonarmap.spectral.verify.hypothesis_testing import HypothesisTest
from sonarmap.spectral.verify.verifier import Verifier
from tests.spectral.verify.test_verifier import EDGE, TRUE, VOXEL, observed, shift_of, two_scans
from tests.spectral.verify.test_verifier import hypothesis as refined

ASIDE = np.array([5.0, -4.0, 0.0])  # voxels


@pytest.fixture(scope="module")
def pair_test() -> HypothesisTest:
    """Of two scans whose grids' centers lie 18 and -18 voxels apart."""
    return HypothesisTest(Verifier(choose_device(), EDGE), Grid(EDGE, VOXEL), *two_scans(), Bounds(np.pi, None, VOXEL))


def true_shift(pair_test: HypothesisTest) -> np.ndarray:
    return shift_of((pair_test.target, pair_test.source))


def looked_at(pair_test: HypothesisTest, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    return observed(pair_test.verifier, (pair_test.target, pair_test.source), hypotheses, 500)


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
    true, beside = (refined(TRUE.rotation, true_shift(pair_test) + offset) for offset in (0 * ASIDE, 2 * ASIDE))
    for both in ([true, beside], [beside, true]):
        hypotheses = pair_test.compare(looked_at(pair_test, both))
        assert off(pair_test, hypotheses[0]) < 1.0
        assert all(hypotheses[0].score > other.score for other in hypotheses[1:])


def test_what_looks_hopeless_is_not_compared(pair_test: HypothesisTest, monkeypatch: pytest.MonkeyPatch) -> None:
    both = [refined(TRUE.rotation, true_shift(pair_test) + offset) for offset in (0 * ASIDE, 2 * ASIDE)]
    true, beside = looked_at(pair_test, both)
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
