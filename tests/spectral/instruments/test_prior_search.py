"""Where priors let one search: rotations about the measured one, and the box of shifts."""

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
    SURE,
    T_SOURCE,
    T_TARGET,
    T_TRUE,
    Kinds,
    about_vertical,
    between,
    names_of,
    pair,
    unexact,
)

DRAWS = 500


class TestTurned:
    def test_no_turn_and_no_tilt_is_the_measured_rotation(self) -> None:
        turned = pair(ATTITUDE, HEADING).turned(np.zeros(1), np.zeros((1, 2)))
        assert turned.as_quat().shape == (1, 4)
        np.testing.assert_allclose(turned.as_matrix()[0], T_TRUE.rotation.as_matrix(), atol=1e-14)

    def test_all_tilts_of_a_turn_come_before_the_next_turn(self) -> None:
        turns, tilts = np.array([0.3, -1.1]), np.array([[0.0, 0.0], [0.05, 0.02], [-0.01, 0.04]])
        relative = pair(ATTITUDE, HEADING)
        turned = relative.turned(turns, tilts)
        assert len(turned) == 6
        poses = RigidTransform.from_rotation(turned)
        want = [[*tilt, turn] for turn in turns for tilt in tilts]
        np.testing.assert_allclose(relative.residuals(poses), want, atol=1e-12)

    def test_tilts_are_about_east_and_north(self) -> None:
        """A positive tilt about East lifts what lies North of the source, one about North lowers what lies East."""
        turned = pair(ATTITUDE, HEADING).turned(np.zeros(1), np.array([[0.1, 0.0], [0.0, 0.1]]))
        in_world = T_TARGET.rotation * turned * T_SOURCE.rotation.inv()
        sine, cosine = np.sin(0.1), np.cos(0.1)
        np.testing.assert_allclose(in_world[0].apply([0, 1, 0]), [0, cosine, sine], atol=1e-12)
        np.testing.assert_allclose(in_world[1].apply([1, 0, 0]), [cosine, 0, -sine], atol=1e-12)

    def test_a_turn_leaves_up_where_it_is(self) -> None:
        turned = pair(ATTITUDE).turned(np.array([0.7]), np.zeros((1, 2)))
        in_world = T_TARGET.rotation * turned * T_SOURCE.rotation.inv()
        np.testing.assert_allclose(in_world.apply([0, 0, 1]), [[0, 0, 1]], atol=1e-12)
        np.testing.assert_allclose(in_world.apply([1, 0, 0]), [[np.cos(0.7), np.sin(0.7), 0]], atol=1e-12)


class TestReaches:
    def test_the_tilts_sigma_is_that_of_the_less_sure_axis_of_both_scans(self) -> None:
        sigmas = np.array([0.03, 0.01, 1, 1, 1, 1]), np.array([0.04, 0.02, 1, 1, 1, 1])
        relative = RelativePrior(PosePrior(T_TARGET, sigmas[0]), PosePrior(T_SOURCE, sigmas[1]))
        assert relative.tilt_sigma == pytest.approx(0.05)

    @pytest.mark.parametrize(
        ("target", "source"), [((HEADING,), ALL), (ALL, (HEADING,)), ((DEPTH,), (DEPTH,))], ids=names_of
    )
    def test_it_is_infinite_without_both_attitudes(self, target: Kinds, source: Kinds) -> None:
        assert between(target, source).tilt_sigma == np.inf

    def test_the_turns_reach_is_four_sigmas_and_half_a_turn_at_most(self) -> None:
        assert between(ALL, ALL).turn_reach == pytest.approx(4 * np.sqrt(2) * SURE[2])
        unsure = np.array([0.1, 0.1, 0.8, 1, 1, 1])
        assert between(ALL, ALL, unsure).turn_reach == pytest.approx(np.pi)
        assert between((ATTITUDE, HEADING), (ATTITUDE,)).turn_reach == np.pi


class TestShiftBox:
    @pytest.mark.parametrize(
        ("target", "source"),
        [
            ((ATTITUDE, HEADING, POSITION), ALL),
            ((ATTITUDE, HEADING, DEPTH), ALL),
            (ALL, (ATTITUDE, HEADING, POSITION)),
            ((ATTITUDE, POSITION, DEPTH), (ATTITUDE, POSITION, DEPTH)),
            ((HEADING, POSITION, DEPTH), (HEADING, POSITION, DEPTH)),
            ((), ()),
        ],
        ids=names_of,
    )
    def test_none_where_something_is_not_measured(self, target: Kinds, source: Kinds) -> None:
        assert between(target, source).shift_box(T_TRUE.rotation) is None

    def test_the_sources_attitude_does_not_matter(self) -> None:
        box, same = (between(ALL, source).shift_box(T_TRUE.rotation) for source in (ALL, (POSITION, DEPTH)))
        assert box is not None
        assert same is not None
        np.testing.assert_allclose(box, same, atol=1e-12)

    def test_exact_instruments_leave_a_point(self) -> None:
        box = between(ALL, ALL, np.full(6, 1e-9)).shift_box(T_TRUE.rotation)
        assert box is not None
        np.testing.assert_allclose(box[0], T_TRUE.translation, atol=1e-12)
        np.testing.assert_allclose(box[1], 0, atol=1e-6)

    def test_its_widths_are_along_the_targets_axes(self) -> None:
        """The target looks North: East's error is along its y axis, backward."""
        sigmas = np.array([1e-6, 1e-6, 1e-6, 3.0, 1.0, 0.2])
        target, source = about_vertical(np.pi / 2, (1, 2, 3)), about_vertical(0.4, (5, 9, 4))
        box = RelativePrior(PosePrior(target, sigmas), PosePrior(source, sigmas)).shift_box(Rotation.identity())
        assert box is not None
        np.testing.assert_allclose(box[0], [7, -4, 1], atol=1e-9)
        np.testing.assert_allclose(box[1], 4 * np.sqrt(2) * np.array([1.0, 3.0, 0.2]), rtol=1e-4)

    def test_the_truth_lies_in_it_four_sigmas_from_the_sides(self) -> None:
        rng = np.random.default_rng(8)
        off = []
        for _ in range(DRAWS):
            relative = RelativePrior(unexact(T_TARGET, rng, SURE), unexact(T_SOURCE, rng, SURE))
            box = relative.shift_box(T_TRUE.rotation)
            assert box is not None
            off.append((T_TRUE.translation - box[0]) / box[1])
        assert (np.abs(off) > 1).sum() <= 2  # 0.1 are to be expected
        np.testing.assert_allclose(np.std(off, axis=0), 0.25, rtol=4 / np.sqrt(2 * DRAWS))
