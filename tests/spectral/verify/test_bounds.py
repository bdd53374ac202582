"""The sweep of rotations with measured attitudes, and the box of shifts."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

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
    return relative.residuals(RigidTransform.from_rotation(R))[:, 2]


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
            tilt = relative.residuals(RigidTransform.concatenate([RigidTransform.from_rotation(true)]))[0, :2]
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
        residuals = relative.residuals(RigidTransform.from_rotation(sweep.R)).reshape(-1, each, 3)
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
