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


def test_without_instruments_it_is_the_registration_itself() -> None:
    given = registration(0, by_scans=False, alternatives=(registration(1, by_scans=False),))
    assert given.by_scans is given
