"""The sweep of rotations with measured attitudes, and the box of shifts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import norm

from sonarmap.spectral.prior import RelativePrior
from sonarmap.spectral.verify.bounds import Bounds
from tests.samples.relative_priors import (
    ALL,
    ATTITUDE,
    DEPTH,
    HEADING,
    POSITION,
    SIGMAS,
    T_SOURCE,
    T_TARGET,
    T_TRUE,
    pair,
    prior,
    unexact,
)

SURE = np.deg2rad([1.0, 1.5, 5.0, 100, 100, 5])


def bounds(prior: RelativePrior | None, voxel: float = 0.5) -> Bounds:
    return Bounds(np.pi, prior, voxel)


def world_turns(relative: RelativePrior, R: Rotation) -> np.ndarray:
    """Turns of rotations from the measured one, (n,) [rad]."""
    return relative.at(R, np.zeros(3)).residual[:, 2]


class TestSweep:
    def test_there_is_no_sweep_without_both_attitudes(self) -> None:
        unsure_target = RelativePrior(prior(T_TARGET, HEADING, POSITION), prior(T_SOURCE, *ALL))
        for relative in (None, pair(HEADING, POSITION, DEPTH), pair(DEPTH), unsure_target):
            assert bounds(relative).sweep is None

        # nor where the less sure axis of both scans together is less sure than three degrees
        for degrees, swept in ((2.2, False), (2.1, True)):
            sigmas = np.array([0.01, np.deg2rad(degrees), 0.1, 1, 1, 1])
            assert (bounds(pair(ATTITUDE, sigmas=sigmas)).sweep is not None) is swept

    @pytest.mark.parametrize("kinds", [pytest.param((ATTITUDE,), marks=pytest.mark.slow), (ATTITUDE, HEADING)])
    def test_the_truth_lies_near_a_rotation_of_it(self, kinds: tuple[slice, ...]) -> None:
        """Half of 4 degrees from the nearest turn, and of tilts within 2 sigmas a sigma from the nearest tilt."""
        rng = np.random.default_rng(3)
        tried = 0
        for _ in range(150):
            R_target, R_source = Rotation.random(2, rng=rng)
            T_target, T_source = (RigidTransform.from_rotation(R) for R in (R_target, R_source))
            measured = (unexact(T, rng, SURE, most=2.5) for T in (T_target, T_source))
            relative = RelativePrior(*(prior(each.T_world_sensor, *kinds, sigmas=SURE) for each in measured))
            true = R_target.inv() * R_source
            tilt = relative.at(true, np.zeros(3)).residual[0, :2]
            sweep = bounds(relative).sweep
            assert sweep is not None
            off = (sweep.R.inv() * true).magnitude().min()
            if np.linalg.norm(tilt) < 2 * relative.tilt_sigma:
                tried += 1
                assert off < np.hypot(np.deg2rad(1.1), 0.85 * relative.tilt_sigma)
        assert tried > 100

    def test_without_headings_turns_go_all_around(self) -> None:
        sweep = bounds(pair(ATTITUDE)).sweep
        assert sweep is not None
        turns = world_turns(pair(ATTITUDE, HEADING), sweep.R)
        about = np.sort(turns[:: sweep.tilts] % (2 * np.pi))
        gaps = np.diff(np.append(about, about[0] + 2 * np.pi))
        assert np.rad2deg(gaps.max()) < 2.1
        assert np.rad2deg(gaps.min()) > 1.75

    def test_headings_bound_the_turns(self) -> None:
        relative = pair(ATTITUDE, HEADING)
        sweep = bounds(relative).sweep
        assert sweep is not None
        turns = np.unique(np.round(world_turns(relative, sweep.R), 9))
        reach = 4 * np.sqrt(2) * SIGMAS[2]
        assert turns.min() == pytest.approx(-reach)
        assert turns.max() == pytest.approx(reach)
        assert np.rad2deg(np.diff(turns).max()) < 2.01
        assert 0.0 in turns

    def test_a_turn_comes_with_all_its_tilts_the_measured_one_first(self) -> None:
        relative = pair(ATTITUDE, HEADING)
        sweep = bounds(relative).sweep
        assert sweep is not None
        each = sweep.tilts
        assert len(sweep.R) % each == 0
        residuals = relative.at(sweep.R, np.zeros(3)).residual.reshape(-1, each, 3)
        np.testing.assert_allclose(residuals[:, :, 2], residuals[:, :1, 2] + np.zeros(each), atol=1e-9)
        assert len(np.unique(np.round(residuals[:, 0, 2], 9))) == len(residuals)
        tilts = residuals[:, :, :2] / relative.tilt_sigma
        np.testing.assert_allclose(tilts[:, 0], 0, atol=1e-9)
        lengths = np.repeat([1.0, 2.0], 6) + np.zeros((len(tilts), 1))
        np.testing.assert_allclose(np.linalg.norm(tilts[:, 1:], axis=2), lengths, atol=0.03)
        np.testing.assert_allclose(tilts.mean(axis=1), 0, atol=1e-9)

    def test_uncertain_headings_do_not_bound_turns(self) -> None:
        sigmas = np.array([0.01, 0.02, 0.6, 1, 1, 1])
        swept, all_around = (bounds(pair(*kinds, sigmas=sigmas)).sweep for kinds in ((ATTITUDE, HEADING), (ATTITUDE,)))
        assert swept is not None
        assert all_around is not None
        assert len(swept.R) == len(all_around.R)
        assert swept.apart == all_around.apart


class TestShiftBox:
    def test_there_is_no_box_without_bounds_on_all_axes(self) -> None:
        for relative in (None, pair(ATTITUDE, HEADING, DEPTH), pair(HEADING, POSITION, DEPTH)):
            assert bounds(relative).shift_box(T_TRUE.rotation) is None

    @pytest.mark.parametrize("voxel", [0.25, 2.0])
    def test_the_same_tolerance_is_added_on_all_sides(self, voxel: float) -> None:
        relative = pair(*ALL)
        measured, box = relative.shift_box(T_TRUE.rotation), bounds(relative, voxel).shift_box(T_TRUE.rotation)
        assert measured is not None
        assert box is not None
        np.testing.assert_array_equal(box[0], measured[0])
        np.testing.assert_allclose(box[1] - measured[1], 6 * voxel)


class TestOddsOfPlace:
    def test_they_are_those_of_the_normal_distribution_about_the_measured_pose(self) -> None:
        """The source is 20 m from the target; only East and North are unsure."""
        sigmas = np.array([1e-4, 1e-4, 1e-4, 1.2, 1.8, 0.1])
        relative, both = pair(*ALL, sigmas=sigmas), np.sqrt(2) * sigmas[3:5]
        away = T_TARGET.rotation.inv().apply([1.5, -2.5, 0.0])
        T = RigidTransform.from_components(T_TRUE.translation + away, T_TRUE.rotation)
        east, north = (
            norm.cdf((off + 4.0) / s) - norm.cdf((off - 4.0) / s) for off, s in zip((1.5, -2.5), both, strict=True)
        )
        share = 0.95 * east * north
        assert bounds(relative).odds_of_place(T, 0.5) == pytest.approx(share / (1 - share), rel=1e-3)

    def test_sure_instruments_are_still_wrong_in_one_of_twenty(self) -> None:
        assert bounds(pair(*ALL, sigmas=np.full(6, 1e-3))).odds_of_place(T_TRUE, 0.5) == pytest.approx(19.0)

    def test_only_instruments_that_measure_all_directions_count(self) -> None:
        sure = np.full(6, 1e-3)
        for kinds in ((ATTITUDE, HEADING, DEPTH), (HEADING, POSITION, DEPTH)):
            assert bounds(pair(*kinds, sigmas=sure)).odds_of_place(T_TRUE, 0.5) == 1.0
        assert bounds(None).odds_of_place(T_TRUE, 0.5) == 1.0
        expected = replace(bounds(pair(*ALL, sigmas=sure)), by_instruments=False)
        assert expected.odds_of_place(T_TRUE, 0.5) == 1.0
        # and bounds that leave many places say nothing about any
        assert bounds(pair(*ALL, sigmas=np.full(6, 30.0))).odds_of_place(T_TRUE, 0.5) == 1.0

    def test_they_depend_neither_on_the_heading_nor_on_which_scan_is_the_target(self) -> None:
        sigmas = np.array([0.02, 0.02, 0.03, 2.5, 2.5, 0.2])
        expected = bounds(pair(*ALL, sigmas=sigmas)).odds_of_place(T_TRUE, 0.5)
        assert 1.0 < expected < 19.0
        turn = RigidTransform.from_components([50.0, -9.0, 3.0], Rotation.from_euler("Z", 2.1))
        turned = RelativePrior(*(prior(turn * T, *ALL, sigmas=sigmas) for T in (T_TARGET, T_SOURCE)))
        assert bounds(turned).odds_of_place(T_TRUE, 0.5) == pytest.approx(expected, rel=1e-3)
        swapped = RelativePrior(*(prior(T, *ALL, sigmas=sigmas) for T in (T_SOURCE, T_TARGET)))
        assert bounds(swapped).odds_of_place(T_TRUE.inv(), 0.5) == pytest.approx(expected, rel=0.02)
