"""Shifts that priors allow: laws of relative poses, with values that distinguish all axes and signs."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.prior import RelativePrior
from sonarmap.spectral.scan import PosePrior
from tests.samples.relative_priors import (
    ALL,
    ATTITUDE,
    DEPTH,
    HEADING,
    POSITION,
    SIGMAS,
    T_PAIRS,
    T_SOURCE,
    T_TARGET,
    T_TRUE,
    about_vertical,
    pair,
    prior,
    random_rotations,
)


class TestShifts:
    DIVED = RigidTransform.from_components([0, 0, -2.0], Rotation.from_euler("Y", 30, degrees=True))  # nose down

    @pytest.mark.parametrize(("T_target", "T_source"), T_PAIRS)
    @pytest.mark.parametrize("kinds", [(DEPTH,), (POSITION,), (ATTITUDE, DEPTH), (ATTITUDE, POSITION), ALL])
    def test_the_truth_is_allowed(self, kinds, T_target, T_source):
        exact = np.full(6, 1e-7)
        relative = RelativePrior(prior(T_target, *kinds, sigmas=exact), prior(T_source, *kinds, sigmas=exact))
        T = T_target.inv() * T_source
        assert relative.allows_shift(T.translation, T.rotation)

    def test_the_vertical_is_the_worlds_not_the_sensors(self) -> None:
        """Nose down by 30 degrees, 10 m ahead are 5 m lower and 10 m up are 8.66 m higher."""
        t = np.array([[10.0, 0, 0], [0, 0, 10], [0, 10, 0], [-10, 0, 0]])
        for height, allowed in ((-7.0, 0), (6.66, 1), (-2.0, 2), (3.0, 3)):
            source = RigidTransform.from_translation([0, 0, height])
            relative = RelativePrior(
                prior(self.DIVED, ATTITUDE, DEPTH, sigmas=np.full(6, 1e-3)),
                prior(source, ATTITUDE, DEPTH, sigmas=np.full(6, 1e-3)),
            )
            expected = np.arange(4) == allowed
            np.testing.assert_array_equal(relative.allows_shift(t, Rotation.identity(), slack=0.05), expected)

    def test_east_and_north_need_the_heading(self) -> None:
        """Forward is North: 10 m ahead are 10 m North, 10 m to the left are 10 m West."""
        sigmas = np.full(6, 1e-3)
        north = about_vertical(np.pi / 2)
        t = np.array([[10.0, 0, 0], [0, 10, 0], [0, -10, 0], [0, 0, 10]])
        for kinds, allowed in (((ATTITUDE, HEADING), [0]), ((ATTITUDE,), [0, 1, 2])):
            target = prior(north, *kinds, POSITION, sigmas=sigmas)
            source = prior(about_vertical(0.3, (0, 10, 4)), POSITION, sigmas=sigmas)
            answer = RelativePrior(target, source).allows_shift(t, Rotation.identity(), slack=0.05)
            np.testing.assert_array_equal(np.flatnonzero(answer), allowed)

    @pytest.mark.parametrize(("axis", "sigma"), [(0, 2.0), (1, 3.0), (2, 0.1)])
    def test_four_sigmas_and_the_slack_per_axis(self, axis: int, sigma: float) -> None:
        sharp = SIGMAS * [1e-6, 1e-6, 1e-6, 1, 1, 1]
        relative = pair(*ALL, sigmas=sharp)
        limit = 4 * np.hypot(sigma, sigma)

        def moved(by: float) -> np.ndarray:
            return T_TARGET.inv().apply(T_SOURCE.translation + by * np.eye(3)[axis])

        for sign in (1, -1):
            assert relative.allows_shift(moved(sign * 0.999 * limit), T_TRUE.rotation)
            assert not relative.allows_shift(moved(sign * 1.001 * limit), T_TRUE.rotation)
            assert relative.allows_shift(moved(sign * (limit + 0.49)), T_TRUE.rotation, slack=0.5)
            assert not relative.allows_shift(moved(sign * (limit + 0.51)), T_TRUE.rotation, slack=0.5)

    @pytest.mark.parametrize(
        ("at", "turn", "lift", "allowed"),
        [
            # 100 m ahead 0.01 rad of pitch are 1 m of height; a heading known to 0.03 rad moves what is far aside
            *(([100.0, 0, 0], [0, 0, 0], lift, lift < 4) for lift in (3.92, 4.08)),
            *(([100.0, 0, 0], [0, 0, turn], 0, turn < 0.12) for turn in (0.117, 0.123)),
        ],
    )
    def test_an_uncertain_rotation_widens_the_bound_with_distance(self, at, turn, lift, allowed) -> None:
        target = PosePrior(RigidTransform.identity(), np.array([0.02, 0.01, 0.03, 1e-3, 1e-3, 1e-3]))
        relative = RelativePrior(target, PosePrior(RigidTransform.from_translation(at), np.full(6, 1e-3)))
        t = Rotation.from_rotvec(turn).apply(at) + np.array([0, 0, lift])
        assert relative.allows_shift(t, Rotation.identity()) == allowed

    def test_without_attitude_only_the_length_is_bounded(self) -> None:
        length = np.linalg.norm(T_TRUE.translation)
        directions = random_rotations(50, 8).apply([1.0, 0, 0])
        relative = pair(POSITION, DEPTH, sigmas=np.full(6, 0.1))
        limit = 4 * np.hypot(0.1, 0.1)
        assert relative.allows_shift(directions * length, T_TRUE.rotation).all()
        assert not relative.allows_shift(directions * (length + 1.01 * limit), T_TRUE.rotation).any()
        assert not relative.allows_shift(directions * (length - 1.01 * limit), T_TRUE.rotation).any()
        deep = pair(DEPTH, sigmas=np.full(6, 0.1))  # 4.5 m lower: no shorter than that, but as long as it likes
        assert deep.allows_shift(directions * 1000, T_TRUE.rotation).all()
        assert not deep.allows_shift(directions * (4.5 - 1.01 * limit), T_TRUE.rotation).any()

    def test_one_shift_can_be_tested_with_many_rotations(self) -> None:
        relative = RelativePrior(prior(T_TARGET, DEPTH), prior(T_SOURCE, ATTITUDE, DEPTH))
        rotations = T_TRUE.rotation * Rotation.from_rotvec([[0, 0, 0], [0.0, 0.8, 0]])
        assert relative.allows_shift(T_TRUE.translation, rotations).tolist() == [True, False]
        both = np.stack([T_TRUE.translation] * 2)
        assert relative.allows_shift(both, rotations).tolist() == [True, False]
        assert pair(*ALL).allows_shift(T_TRUE.translation, rotations).tolist() == [True, True]

    def test_the_sources_attitude_suffices_with_the_rotation(self) -> None:
        sigmas = np.full(6, 1e-3)
        target, source = prior(T_TARGET, POSITION, DEPTH, sigmas=sigmas), prior(T_SOURCE, *ALL, sigmas=sigmas)
        relative = RelativePrior(target, source)
        off = T_TRUE.translation + Rotation.from_rotvec([0.3, 0.2, -0.4]).apply([0, 0, 4.0])
        assert relative.allows_shift(T_TRUE.translation, T_TRUE.rotation)
        assert not relative.allows_shift(off, T_TRUE.rotation, slack=0.1)
        assert not relative.allows_shift(T_TRUE.translation, T_TRUE.rotation * Rotation.from_rotvec([0, 0.5, 0]))
