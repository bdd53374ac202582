"""How a vehicle moves at a time, and a second look at doubtful pairs with the motion as a measurement."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.motion.reconsider import is_doubtful, with_both, with_motion, without_leaps
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.result import Registration
from tests.samples.surveys import random_covariance, registration
from tests.slam.motion.test_motion import USUAL, learned, moved, steps

MOTION = learned(steps(40))
EXPECTED = MOTION.expected(5, 6)
TIGHT = random_covariance(np.random.default_rng(3), 0.002, 0.01)
JUMP = moved(np.array([0.1, 0, 3.0, -18.0, 11.0, 0.5]))


def answer(T: RigidTransform, probability: float, accepted: bool = False) -> Registration:
    return replace(registration(T, TIGHT, accepted), probability=probability)


def pair(given: Registration | None) -> RegisteredPair:
    return RegisteredPair(5, 6, "sequential", registration=given)


def with_usual(given: Registration) -> Registration:
    """What is left of it beside the motion."""
    held = with_motion([pair(given)], MOTION)[0].registration
    assert held is not None
    return held


def test_what_is_refused_or_contradicted_is_doubtful() -> None:
    assert not is_doubtful(pair(answer(moved(USUAL), 0.95, accepted=True)), MOTION)
    assert is_doubtful(pair(answer(moved(USUAL), 0.5)), MOTION)
    assert is_doubtful(pair(answer(JUMP, 0.95, accepted=True)), MOTION)
    assert not is_doubtful(pair(None), MOTION)


def test_the_second_look_leads_and_the_first_stays_possible() -> None:
    first = pair(replace(answer(JUMP, 0.9, accepted=True), alternatives=(answer(moved(USUAL), 0.1),)))
    rival = answer(moved(0.5 * USUAL), 0.15)
    second = pair(replace(answer(moved(1.1 * USUAL), 0.8), alternatives=(rival,)))
    second = replace(second, expected=EXPECTED)
    both = with_both(first, second, MOTION)
    assert both.registration is not None
    assert both.registration.probability == 0.8
    assert both.expected is EXPECTED
    kept, jump, usual = both.registration.alternatives
    assert kept is rival
    assert jump.probability == pytest.approx(0.9 * 0.05 * 0.1)
    assert usual.probability == pytest.approx(0.1 * 0.05)
    assert not jump.accepted
    plain = with_both(first, second).registration
    assert plain is not None
    assert plain.probability + sum(each.probability for each in plain.alternatives) <= 1 + 1e-12
    # one that fails changes nothing
    assert with_both(first, pair(None), MOTION) is first


def test_the_motion_holds_what_the_scans_leave_open() -> None:
    """Along a wall that shows nothing else the scans do not tell how far the vehicle went."""
    T = moved(USUAL) * RigidTransform.from_translation([30.0, 0.0, 0.0])
    loose = np.diag([1e-4, 1e-4, 1e-4, 50.0, 1e-4, 1e-4]) ** 2
    near = T * RigidTransform.from_translation([-29.6, 0.0, 0.0])
    held = with_usual(replace(registration(near, loose), probability=0.9))
    away = T.inv() * held.T_target_source
    assert away.translation[0] == pytest.approx(-30.0, abs=0.3 * EXPECTED.sigmas[3])
    np.testing.assert_allclose(away.translation[1:], 0.0, atol=0.01)
    assert held.covariance[3, 3] == pytest.approx(EXPECTED.sigmas[3] ** 2, rel=0.3)
    np.testing.assert_allclose(np.diag(held.covariance)[[0, 1, 2, 4, 5]], 1e-8, rtol=0.01)


def test_the_motion_changes_nothing_that_scans_know() -> None:
    T = moved(USUAL) * RigidTransform.from_exp_coords([0.01, 0.02, -0.03, 0.1, 0.05, -0.1])
    held = with_usual(registration(T, TIGHT))
    moved_by = (T.inv() * held.T_target_source).as_exp_coords()
    assert moved_by @ np.linalg.solve(TIGHT, moved_by) < 0.2
    # information adds: never less sure than by either alone
    assert np.linalg.eigvalsh(TIGHT - held.covariance).min() > -1e-12
    # a jump is left as it is
    assert with_usual(answer(JUMP, 0.9, accepted=True)).T_target_source is JUMP


def test_answers_out_of_reach_are_dropped() -> None:
    far = moved(np.array([0, 0, 0.1, 60.0, 0, 0]))
    given = replace(answer(far, 0.95, accepted=True), alternatives=(answer(far, 0.02), answer(moved(USUAL), 0.03)))
    left = without_leaps(pair(given), MOTION).registration
    assert left is not None
    assert not left.accepted
    assert left.probability == 0
    assert "cannot have come so far" in left.reason
    assert [one.probability for one in left.alternatives] == [0.03]
    near = without_leaps(pair(answer(moved(USUAL), 0.95, accepted=True)), MOTION).registration
    assert near is not None
    assert near.accepted
