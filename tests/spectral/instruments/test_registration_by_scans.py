"""A registration without what instruments said: for a graph that holds their measurements itself."""

from dataclasses import fields, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.result import Registration
from tests.samples.surveys import random_covariance, random_transforms

RNG = np.random.default_rng(4)
POSES, BY_SCANS = random_transforms(RNG, 3), random_transforms(RNG, 3)
COVARIANCES, UNSURE = ([random_covariance(RNG) for _ in range(3)] for _ in range(2))


def registration(n: int, by_scans: bool, alternatives: tuple[Registration, ...] = ()) -> Registration:
    """Numbers of its own in every field."""
    return Registration(
        T_target_source=POSES[n],
        covariance=COVARIANCES[n],
        psr=20.0 + n,
        overlap=0.3 + n / 10,
        accepted=n != 1,
        seconds=0.5 + n,
        reason=f"reason {n}",
        probability=0.9 - n / 10,
        step_psr=(("rotation", 0.4 + n),),
        alternatives=alternatives,
        T_by_scans=BY_SCANS[n] if by_scans else None,
        covariance_by_scans=UNSURE[n] if by_scans else None,
        evidence=(("view", 0.7 + n),),
    )


def same(a: RigidTransform, b: RigidTransform) -> bool:
    return bool((a.as_matrix() == b.as_matrix()).all())


def test_pose_and_covariance_are_those_of_the_scans() -> None:
    given = registration(0, by_scans=True)
    alone = given.by_scans
    assert same(alone.T_target_source, BY_SCANS[0])
    np.testing.assert_array_equal(alone.covariance, UNSURE[0])
    kept = {each.name for each in fields(Registration)} - {"T_target_source", "covariance"}
    for name in kept - {"T_by_scans", "covariance_by_scans"}:
        assert getattr(alone, name) == getattr(given, name)


def test_of_the_alternatives_too() -> None:
    deep = registration(2, by_scans=True)
    given = registration(0, by_scans=True, alternatives=(registration(1, by_scans=True, alternatives=(deep,)),))
    (second,) = given.by_scans.alternatives
    (third,) = second.alternatives
    for n, alternative in ((1, second), (2, third)):
        assert same(alternative.T_target_source, BY_SCANS[n])
        np.testing.assert_array_equal(alternative.covariance, UNSURE[n])
        assert alternative.reason == f"reason {n}"


def test_it_says_no_more_about_the_scans_alone_and_twice_is_once() -> None:
    alone = registration(0, by_scans=True, alternatives=(registration(1, by_scans=True),)).by_scans
    assert alone.T_by_scans is None
    assert alone.covariance_by_scans is None
    assert alone.by_scans is alone


def test_without_instruments_it_is_the_registration_itself() -> None:
    given = registration(0, by_scans=False, alternatives=(registration(1, by_scans=False),))
    assert given.by_scans is given


def test_the_given_one_stays_as_it_was() -> None:
    given = registration(0, by_scans=True)
    before = replace(given)
    _ = given.by_scans
    assert given == before
    assert same(given.T_target_source, POSES[0])
