"""Expected poses as priors of a pair, and a registration without what instruments said."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.prior import relative_prior
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
from tests.samples.surveys import random_covariance, random_transforms

R_EXPECTED = Rotation.from_euler("ZYX", [0.5, 0.1, -0.2])
T_EXPECTED = RigidTransform.from_components([2.0, -0.7, 0.3], R_EXPECTED)
SIGMAS = np.array([0.02, 0.03, 0.2, 0.5, 0.7, 1.1])
EXPECTED = ExpectedPose.along_target(T_EXPECTED, SIGMAS)
T_TARGET = RigidTransform.from_components([100.0, 50.0, -9.0], Rotation.from_euler("ZYX", [1.1, 0.3, -0.4]))


def measured(T: RigidTransform, *known: int, sigma: float = 0.01) -> PosePrior:
    return PosePrior(T, np.where(np.isin(np.arange(6), known), sigma, np.inf))


def test_without_instruments_it_is_what_was_expected_and_fits_its_own_priors() -> None:
    target, source = EXPECTED.priors(None, None)
    expected = target.T_world_sensor.inv() * source.T_world_sensor
    np.testing.assert_allclose(expected.as_matrix(), EXPECTED.T_target_source.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(source.sigmas, SIGMAS, rtol=1e-4)
    assert target.sigmas.max() < 1e-3
    prior = relative_prior(target, source)
    assert prior is not None
    assert prior.normalized(EXPECTED.T_target_source) == (pytest.approx(0, abs=1e-12), 6)


def test_a_measured_attitude_gives_the_tilt_and_the_motion_the_turn() -> None:
    T_source = T_TARGET * EXPECTED.T_target_source
    tilted = Rotation.from_euler("ZYX", [0.0, 0.05, 0.02]) * T_source.rotation
    given = RigidTransform.from_components([0.0, 0.0, 0.0], Rotation.from_euler("Z", 2.0) * tilted)
    target, source = EXPECTED.priors(measured(T_TARGET, 0, 1), measured(given, 0, 1))
    np.testing.assert_allclose(source.sigmas[:2], 0.01)
    up = [0.0, 0.0, 1.0]
    np.testing.assert_allclose(
        source.T_world_sensor.rotation.inv().apply(up), given.rotation.inv().apply(up), atol=1e-12
    )
    relative = target.T_world_sensor.inv() * source.T_world_sensor
    np.testing.assert_allclose(relative.translation, T_EXPECTED.translation, atol=1e-12)
    # the turn is the expected one, but for what the measured tilt takes away
    assert (relative.rotation.inv() * R_EXPECTED).magnitude() < 0.06


@pytest.mark.parametrize("covariance", [np.full((6, 6), np.nan), np.ones(6), np.ones((6, 6))])
def test_bad_covariances_are_refused(covariance: np.ndarray) -> None:
    with pytest.raises(InputError, match="covariance of an expected pose"):
        ExpectedPose(T_EXPECTED, covariance)


RNG = np.random.default_rng(4)
POSES, BY_SCANS = random_transforms(RNG, 3), random_transforms(RNG, 3)
COVARIANCES, UNSURE = ([random_covariance(RNG) for _ in range(3)] for _ in range(2))


def registration(n: int, by_scans: bool, alternatives: tuple[Registration, ...] = ()) -> Registration:
    """Numbers of its own in every field."""
    numbers = 20.0 + n, 0.3 + n / 10, n != 1, 0.5 + n, f"reason {n}", 0.9 - n / 10, (("rotation", 0.4 + n),)
    alone = (BY_SCANS[n], UNSURE[n]) if by_scans else (None, None)
    return Registration(POSES[n], COVARIANCES[n], *numbers, alternatives, *alone, (("view", 0.7 + n),))


def same(a: RigidTransform, b: RigidTransform) -> bool:
    return bool((a.as_matrix() == b.as_matrix()).all())


def test_pose_and_covariance_are_those_of_the_scans_of_the_alternatives_too() -> None:
    third = registration(2, by_scans=True)
    second = registration(1, by_scans=True, alternatives=(third,))
    given = registration(0, by_scans=True, alternatives=(second,))
    before, alone = replace(given), given.by_scans
    replaced = {"T_target_source", "covariance", "T_by_scans", "covariance_by_scans", "alternatives"}
    for n, of in enumerate((given, second, third)):
        assert same(alone.T_target_source, BY_SCANS[n])
        np.testing.assert_array_equal(alone.covariance, UNSURE[n])
        for name in {each.name for each in fields(Registration)} - replaced:
            assert getattr(alone, name) == getattr(of, name)
        # it says no more about the scans alone, and twice is once
        assert alone.T_by_scans is None
        assert alone.covariance_by_scans is None
        assert alone.by_scans is alone
        alone = alone.alternatives[0] if alone.alternatives else alone
    assert given == before
    assert same(given.T_target_source, POSES[0])


@pytest.mark.parametrize("leveled", [False, True])
@pytest.mark.parametrize("heading", [0.0, 200.0])
def test_chi_squared_is_the_same_at_all_headings(leveled: bool, heading: float) -> None:
    """An error of one standard deviation about or along an axis of the target counts 1, however both scans lie."""
    turn = Rotation.from_euler("Z", heading, degrees=True)
    T = RigidTransform.from_components([2.0, -0.7, 0.3], turn)
    expected = ExpectedPose.along_target(T, np.array([0.002, 0.06, 0.03, 0.1, 3.0, 0.5]))
    own = {"sigma": 1e-3} if leveled else {"sigma": np.inf}
    at = RigidTransform.from_rotation(turn)
    target, source = expected.priors(measured(at, 0, 1, **own), measured(at, 0, 1, **own))
    prior = relative_prior(target, source)
    assert prior is not None
    for axis in range(6):
        if leveled and axis < 2:
            continue  # the instruments know the tilt
        error = np.zeros(6)
        error[axis] = expected.sigmas[axis]
        off = RigidTransform.from_components(T.translation + error[3:], Rotation.from_rotvec(error[:3]) * T.rotation)
        assert prior.normalized(off) == (pytest.approx(1.0, rel=0.02), 6), axis
        assert prior.allows(off.rotation)


def test_a_poor_position_does_not_replace_the_motion_but_a_depth_does() -> None:
    T_source = T_TARGET * EXPECTED.T_target_source * RigidTransform.from_translation([9.0, 7.0, 5.0])
    sigmas = np.array([0.01, 0.01, 0.01, 3.0, 3.0, 0.05])
    target, source = EXPECTED.priors(PosePrior(T_TARGET, sigmas), PosePrior(T_source, sigmas))
    shift = target.T_world_sensor.rotation.apply(T_EXPECTED.translation)
    way = source.T_world_sensor.translation - target.T_world_sensor.translation
    np.testing.assert_allclose(way[:2], shift[:2], atol=1e-9)
    assert way[2] == pytest.approx((T_source.translation - T_TARGET.translation)[2])


def test_what_instruments_know_better_counts() -> None:
    T_source = T_TARGET * EXPECTED.T_target_source * RigidTransform.from_translation([0.4, 0.2, 0.1])
    target, source = EXPECTED.priors(measured(T_TARGET, *range(6)), measured(T_source, *range(6)))
    relative = target.T_world_sensor.inv() * source.T_world_sensor
    np.testing.assert_allclose(relative.as_matrix(), (T_TARGET.inv() * T_source).as_matrix(), atol=1e-9)
    np.testing.assert_allclose(source.sigmas[3:], np.hypot(0.01, 0.01))
