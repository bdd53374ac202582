"""Rotations put to the test: shifts and what they mean, distinct candidates, witnesses for and against."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kernels.opencl.device import choose_device
from spectral.grid import Grid
from spectral.prepare.spectral_scan import SpectralScan
from spectral.registration import SpectralRegistrar
from spectral.scan import Scan
from spectral.so3 import RotationPeaks
from spectral.verify.hypothesis import Candidates, Origin
from spectral.verify.icp import Fit
from spectral.verify.verifier import Verifier, consistency
from tests.samples.reliefs import above, relief, seen

EDGE, VOXEL = 64, 0.5
HERE, THERE = above(-5, 3, 12), above(4.0, -6.0, 13, 25, 4, -7)
TRUE = HERE.inv() * THERE
WRONG = Rotation.from_euler("Z", 90, degrees=True) * TRUE.rotation


@pytest.fixture(scope="module")
def verifier() -> Verifier:
    return Verifier(choose_device(), EDGE)


@pytest.fixture(scope="module")
def pair() -> tuple[SpectralScan, SpectralScan]:
    """Two scans whose grids' centers lie 18 and -18 voxels apart."""
    registrar = SpectralRegistrar(choose_device(), Grid(EDGE, VOXEL))
    target, source = (registrar.prepare(Scan(seen(relief(1), T, 15.0))) for T in (HERE, THERE))
    return target, source


def shift_of(pair: tuple[SpectralScan, SpectralScan], T: RigidTransform = TRUE) -> np.ndarray:
    """Between the grids' centers [voxels]."""
    target, source = pair
    return (T.apply(source.volume.center) - target.volume.center) / VOXEL


def peaks(*rotations: Rotation) -> RotationPeaks:
    return RotationPeaks(Rotation.concatenate(rotations), np.linspace(0.9, 0.1, len(rotations)))


def fit(R: Rotation, shift: np.ndarray) -> Fit:
    return Fit(R, shift, np.eye(6), 0.1, 100.0)


class TestConsistency:
    def test_nothing_seen_is_no_consistency(self) -> None:
        assert consistency(0.0, 0.0) == 0

    @pytest.mark.parametrize(("agree", "contradict"), [(0.6, 0.02), (0.1, 0.3), (1.0, 0.0)])
    def test_a_contradiction_weighs_as_four_agreements(self, agree: float, contradict: float) -> None:
        assert consistency(agree, contradict) == pytest.approx(agree / (agree + 4 * contradict + 0.05))

    def test_it_grows_with_agreement_and_falls_with_contradiction(self) -> None:
        shares = np.linspace(0.01, 1, 20)
        assert (np.diff(consistency(shares, 0.1)) > 0).all()
        assert (np.diff(consistency(0.5, shares)) < 0).all()


def origins(*scores: float) -> list[Origin]:
    """Of candidates with these scores of their rotations."""
    return [Origin(score, 20.0) for score in scores]


class TestCandidates:
    def test_the_true_shift_is_named_under_the_true_rotation(self, verifier, pair) -> None:
        found = verifier.candidates(*pair, peaks(WRONG, TRUE.rotation))
        off = np.linalg.norm(found.shifts - shift_of(pair), axis=1)
        right = np.flatnonzero(off < 2.0)
        assert (found.turn[right] == 1).all()
        assert found.psr[right].max() > 1.5 * found.psr[found.turn == 0].max()
        np.testing.assert_allclose((found.R[int(right[0])] * TRUE.rotation.inv()).magnitude(), 0, atol=1e-9)

    def test_the_whole_grid_names_it_to_a_voxel(self, verifier, pair) -> None:
        found = verifier.fine_candidates(*pair, peaks(TRUE.rotation))
        highest = np.argmax(found.psr)
        off = np.linalg.norm(found.shifts - shift_of(pair), axis=1)
        assert off[found.psr == found.psr[highest]].min() < 1.0

    def test_a_shift_stands_for_all_that_it_may_mean(self, verifier) -> None:
        """-3 is also 61, and 1 also -63, but these leave nothing in common of 64 voxels; 20 is also -44."""
        found = {tuple(meaning) for meaning in verifier._meanings(np.array([20.0, -3.0, 1.0]))}
        assert found == {(20.0, -3.0, 1.0), (-44.0, -3.0, 1.0)}
        assert len(verifier._meanings(np.array([20.0, -30.0, 31.5]))) == 8

    def test_those_that_are_wanted_are_kept_in_order(self) -> None:
        R = Rotation.from_euler("Z", [[0], [10], [20], [30]], degrees=True)
        scores = np.array([0.4, 0.3, 0.2, 0.1])
        all_four = Candidates(
            np.array([0, 1, 2, 3]), R, np.arange(12.0).reshape(4, 3), np.array([9.0, 8, 7, 6]), scores
        )
        some = all_four.only(np.array([False, True, False, True]))
        assert some.turn.tolist() == [1, 3]
        np.testing.assert_array_equal(some.shifts, [[3, 4, 5], [9, 10, 11]])
        assert some.psr.tolist() == [8, 6]
        assert some.origin(1) == Origin(0.1, 6.0)
        np.testing.assert_allclose(some.R.as_euler("ZYX", degrees=True)[:, 0], [10, 30])
        assert len(all_four.only(np.zeros(4, dtype=bool)).psr) == 0

    def test_the_best_is_the_true_one_and_none_is_told_twice(self, verifier, pair) -> None:
        nearby = Rotation.from_rotvec([0, 0, 0.03]) * TRUE.rotation
        found = verifier.candidates(*pair, peaks(WRONG, nearby, TRUE.rotation))
        best = verifier.best(*pair, found, 5)
        assert len(best) == 5
        first = found.only(np.arange(len(found.psr)) == best[0])
        assert np.linalg.norm(first.shifts[0] - shift_of(pair)) < 3.0
        for n, one in enumerate(best):
            for other in best[:n]:
                apart = np.linalg.norm(found.shifts[one] - found.shifts[other])
                turned = (found.R[int(one)].inv() * found.R[int(other)]).magnitude()
                assert apart > 6.0 or turned > np.deg2rad(4.99)


class TestWitnesses:
    def test_the_true_pose_is_told_from_one_that_is_off(self, verifier, pair) -> None:
        fits = [fit(TRUE.rotation, shift_of(pair) + np.array([0, 0, 6.0])), fit(TRUE.rotation, shift_of(pair))]
        best, other = verifier.judge(*pair, fits, origins(0.1, 0.9))
        assert best.fit is fits[1]
        assert best.consistency > 0.8 > 2 * other.consistency
        assert best.origin == Origin(0.9, 20.0)

    def test_poses_that_came_out_at_one_place_are_one(self, verifier, pair) -> None:
        turned = Rotation.from_rotvec([0, 0, 0.02]) * TRUE.rotation
        fits = [fit(turned, shift_of(pair) + 1.0), fit(TRUE.rotation, shift_of(pair)), fit(WRONG, shift_of(pair))]
        kept = verifier.judge(*pair, fits, origins(0.5, 0.4, 0.3))
        assert [one.fit for one in kept] == [fits[1], fits[2]]

    def test_on_the_whole_grid_only_the_true_pose_has_a_peak(self, verifier, pair) -> None:
        fits = [fit(TRUE.rotation, shift_of(pair)), fit(WRONG, shift_of(pair))]
        right, wrong = (
            verifier.verify(*pair, one, verifier.overlap(*pair, one.fit))
            for one in verifier.judge(*pair, fits, origins(0.5, 0.4))
        )
        assert right.fit is fits[0]
        assert right.psr > 30 > 10 > wrong.psr
        assert right.overlap > 0.35
        assert right.coarse_psr > 2 * wrong.coarse_psr
        assert right.score == pytest.approx(right.refined.consistency**3 * np.sqrt(right.psr * right.coarse_psr))

    def test_without_a_view_the_points_in_common_are_the_witness(self, verifier, pair) -> None:
        blind = tuple(replace(scan, image=replace(scan.image, single=False)) for scan in pair)
        fits = [fit(TRUE.rotation, shift_of(pair))]
        judged = verifier.judge(*blind, fits, origins(0.5))[0]
        assert judged.consistency == verifier.overlap(*pair, judged.fit)
        assert judged.consistency != verifier.judge(*pair, fits, origins(0.5))[0].consistency
        found = verifier.candidates(*blind, peaks(WRONG, TRUE.rotation))
        best = verifier.best(*blind, found, 1)
        assert np.linalg.norm(found.shifts[best[0]] - shift_of(pair)) < 3.0
