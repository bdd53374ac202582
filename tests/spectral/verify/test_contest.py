"""The hypotheses of a pair against each other: what the finalists lack, and how the best comes to its end."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kernels.opencl.device import choose_device
from spectral.grid import Grid
from spectral.registration import SpectralRegistrar
from spectral.scan import Scan
from spectral.verify.bounds import Bounds
from spectral.verify.hypothesis import Origin, Refined
from spectral.verify.hypothesis_test import Contest
from spectral.verify.icp import Fit
from spectral.verify.verifier import Verifier
from tests.samples.reliefs import above, relief, seen

EDGE, VOXEL = 64, 0.5
HERE, THERE = above(-5, 3, 12), above(4.0, -6.0, 13, 25, 4, -7)
TRUE = HERE.inv() * THERE
ASIDE = np.array([5.0, -4.0, 0.0])  # voxels


@pytest.fixture(scope="module")
def contest() -> Contest:
    """Of two scans whose grids' centers lie 18 and -18 voxels apart."""
    device, grid = choose_device(), Grid(EDGE, VOXEL)
    registrar = SpectralRegistrar(device, grid)
    target, source = (registrar.prepare(Scan(seen(relief(1), T, 15.0))) for T in (HERE, THERE))
    return Contest(Verifier(device, EDGE), ThreadPoolExecutor(2), grid, target, source, Bounds(np.pi, None, VOXEL))


def true_shift(contest: Contest) -> np.ndarray:
    """Between the grids' centers [voxels]."""
    return (TRUE.apply(contest.source.volume.center) - contest.target.volume.center) / VOXEL


def refined(R: Rotation, shift: np.ndarray) -> Refined:
    return Refined(Fit(R, shift, np.eye(6), 0.1, 100.0), Origin(0.5, 20.0), 0.5)


def off(contest: Contest, one: Refined) -> float:
    """How far its shift is from the true one [voxels]."""
    return float(np.linalg.norm(one.fit.shift - true_shift(contest)))


class TestMissed:
    def test_the_true_place_is_named_where_all_finalists_lie_beside_it(self, contest: Contest) -> None:
        beside = [refined(TRUE.rotation, true_shift(contest) + off) for off in (ASIDE, -ASIDE)]
        found = contest.missed(beside)
        assert off(contest, found[0]) < 1.0
        assert len(found) <= len(beside)

    def test_what_is_a_finalist_is_not_named_again(self, contest: Contest) -> None:
        found = contest.missed([refined(TRUE.rotation, true_shift(contest))])
        assert all(off(contest, one) > 2.0 for one in found)

    def test_what_the_bounds_forbid_is_not_named(self, contest: Contest) -> None:
        level = replace(contest, bounds=Bounds(np.deg2rad(3.0), None, VOXEL))
        found = level.missed([refined(TRUE.rotation, true_shift(contest) + ASIDE)])
        assert all(off(contest, one) > 2.0 for one in found)

    def test_nothing_is_named_where_no_shift_may_be_meant(self, contest: Contest, monkeypatch) -> None:
        monkeypatch.setattr(Bounds, "allow_shifts", lambda _bounds, _R, shifts: np.zeros(len(shifts), dtype=bool))
        assert contest.missed([refined(TRUE.rotation, true_shift(contest))]) == []


def test_the_true_place_wins_however_the_finalists_are_ordered(contest: Contest) -> None:
    true, beside = refined(TRUE.rotation, true_shift(contest)), refined(TRUE.rotation, true_shift(contest) + 2 * ASIDE)
    for both in ([true, beside], [beside, true]):
        found = contest.compared(both)
        assert off(contest, found[0].refined) < 1.0
        assert found[0].score > found[-1].score


def test_any_number_of_threads_finds_the_same(contest: Contest) -> None:
    rough = [refined(TRUE.rotation, true_shift(contest) + offset) for offset in (0 * ASIDE, 0.2 * ASIDE, 2 * ASIDE)]
    one, three = (replace(contest, pool=ThreadPoolExecutor(n)).compared(rough) for n in (1, 3))
    assert [found.score for found in one] == [found.score for found in three]
    for a, b in zip(one, three, strict=True):
        np.testing.assert_array_equal(a.fit.shift, b.fit.shift)


def test_the_best_ends_nearer_and_stands_once(contest: Contest) -> None:
    rough = refined(Rotation.from_rotvec([0, 0, 0.01]) * TRUE.rotation, true_shift(contest) + 0.8)
    first = contest.compared([rough])[0]
    best, *others = contest.settled([first, replace(first, psr=first.psr / 2)], spectral=False)
    assert others == []
    assert off(contest, best.refined) < min(0.3, off(contest, rough))
    T = contest.transform(best.fit)
    np.testing.assert_allclose(T.translation, TRUE.translation, atol=0.3 * VOXEL)
    assert np.rad2deg((T.rotation.inv() * TRUE.rotation).magnitude()) < 0.3
