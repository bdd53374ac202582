"""Priors as measurements: what a pose differs by from them and how sure that is, and where they let one search."""

from itertools import product

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
    knowing,
    names_of,
    pair,
    unexact,
)

EVERY: list[Kinds] = [
    tuple(kind for kind, known in zip(ALL, knows, strict=True) if known) for knows in product([True, False], repeat=4)
]


def known(target: Kinds, source: Kinds) -> list[bool]:
    """Of tilt, tilt, turn, East, North and Up, those that instruments measure in full."""
    both = [kind in target and kind in source for kind in ALL]
    attitude, heading, position, depth = both
    leveled = ATTITUDE in target or ATTITUDE in source
    headed = any(ATTITUDE in kinds and HEADING in kinds for kinds in (target, source))
    return [attitude, attitude, attitude and heading, position and headed, position and headed, depth and leveled]


def stack(T: RigidTransform) -> RigidTransform:
    return RigidTransform.concatenate([T])


def tilted(tilt: tuple[float, float], turn: float) -> RigidTransform:
    """The true pose with its tilt and turn in the world off by these [rad], and its shift off."""
    off = Rotation.from_rotvec([*tilt, 0]) * Rotation.from_euler("Z", turn)
    R = T_TARGET.rotation.inv() * off * T_SOURCE.rotation
    return RigidTransform.from_components(T_TRUE.translation + np.array([0.7, -0.4, 0.3]), R)


@pytest.mark.parametrize("target", EVERY, ids=names_of)
class TestWhateverIsKnown:
    @pytest.mark.quick_cases(5)
    def test_the_measured_pose_has_no_residuals(self, target: Kinds) -> None:
        for source in EVERY:
            residuals = between(target, source).residuals(stack(T_TRUE))
            assert residuals.shape == (1, sum(known(target, source)))
            np.testing.assert_allclose(residuals, 0, atol=1e-12)


class TestResiduals:
    def test_they_are_the_tilts_the_turn_and_the_shift_in_the_world_in_this_order(self) -> None:
        tilt, turn, shift = (0.03, -0.05), 0.2, np.array([1.0, 2.0, -3.0])
        T = tilted(tilt, turn)
        t = T_TRUE.translation + T_TARGET.rotation.inv().apply(shift)
        residuals = pair(*ALL).residuals(stack(RigidTransform.from_components(t, T.rotation)))
        np.testing.assert_allclose(residuals, [[*tilt, turn, *shift]], atol=1e-12)


DRAWS, BOXES = 800, 150


@pytest.fixture(scope="module")
def draws() -> list[tuple[PosePrior, PosePrior]]:
    """Measurements of the true poses, with the instruments' errors."""
    rng = np.random.default_rng(7)
    return [(unexact(T_TARGET, rng, SURE), unexact(T_SOURCE, rng, SURE)) for _ in range(DRAWS)]


def redrawn(draw: tuple[PosePrior, PosePrior], target: Kinds, source: Kinds) -> RelativePrior:
    """As drawn, knowing only some of it; a heading that is not known is written down as another."""
    priors = []
    for measured, kinds, turn in zip(draw, (target, source), (0.0, 1.3), strict=True):
        T = measured.T_world_sensor if HEADING in kinds else about_vertical(turn) * measured.T_world_sensor
        priors.append(PosePrior(T, knowing(*kinds, sigmas=SURE)))
    return RelativePrior(*priors)


@pytest.mark.parametrize(
    ("target", "source"),
    [
        (ALL, ALL),
        ((ATTITUDE, DEPTH), (ATTITUDE, DEPTH)),
        ((ATTITUDE, POSITION, DEPTH), ALL),
        ((HEADING, DEPTH), (ATTITUDE, DEPTH)),
    ],
    ids=names_of,
)
@pytest.mark.slow
def test_the_covariance_is_that_of_the_instruments_errors(draws, target, source):
    """Of 800 draws a whitened variance is within 4 standard deviations of 1, 20 %, and the means are 0."""
    true = stack(T_TRUE)
    residuals = np.array([redrawn(draw, target, source).residuals(true)[0] for draw in draws])
    exact = redrawn((PosePrior(T_TARGET, SURE), PosePrior(T_SOURCE, SURE)), target, source)
    whitening = np.linalg.inv(np.linalg.cholesky(exact.residual_covariance(stack(T_TRUE))[0]))
    white = residuals @ whitening.T
    np.testing.assert_allclose(white.T @ white / DRAWS, np.eye(white.shape[1]), atol=4 * np.sqrt(2 / DRAWS))
    np.testing.assert_allclose(white.mean(axis=0), 0, atol=4 / np.sqrt(DRAWS))


class TestTurned:
    def test_tilts_are_about_east_and_north(self) -> None:
        """A positive tilt about East lifts what lies North of the source, one about North lowers what lies East."""
        turned = pair(ATTITUDE, HEADING).turned(np.zeros(1), np.array([[0.1, 0.0], [0.0, 0.1]]))
        in_world = T_TARGET.rotation * turned * T_SOURCE.rotation.inv()
        sine, cosine = np.sin(0.1), np.cos(0.1)
        np.testing.assert_allclose(in_world[0].apply([0, 1, 0]), [0, cosine, sine], atol=1e-12)
        np.testing.assert_allclose(in_world[1].apply([1, 0, 0]), [cosine, 0, -sine], atol=1e-12)


class TestReaches:
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
            ((ATTITUDE, POSITION, DEPTH), (ATTITUDE, POSITION, DEPTH)),
        ],
        ids=names_of,
    )
    def test_none_where_something_is_not_measured(self, target: Kinds, source: Kinds) -> None:
        assert between(target, source).shift_box(T_TRUE.rotation) is None

    def test_the_truth_lies_in_it_four_sigmas_from_the_sides(self) -> None:
        rng = np.random.default_rng(8)
        off = []
        for _ in range(BOXES):
            relative = RelativePrior(unexact(T_TARGET, rng, SURE), unexact(T_SOURCE, rng, SURE))
            box = relative.shift_box(T_TRUE.rotation)
            assert box is not None
            off.append((T_TRUE.translation - box[0]) / box[1])
        assert (np.abs(off) > 1).sum() <= 2  # 0.1 are to be expected
        np.testing.assert_allclose(np.std(off, axis=0), 0.25, rtol=4 / np.sqrt(2 * BOXES))
