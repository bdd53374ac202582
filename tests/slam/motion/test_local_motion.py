"""How a vehicle moves at a time: what the steps before and behind tell of one."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.motion.local_motion import Step, likeness, rate_of, rates_by_others
from sonarmap.slam.motion.reconsider import with_motion
from sonarmap.slam.pair import Candidate, RegisteredPair
from tests.samples.surveys import random_covariance, registration, step_pair
from tests.slam.motion.test_motion import FLOOR, USUAL, learned

VARIED = np.array([0.02, 0.01, 0.1, 0.2, 0.4, 0.05]) ** 2
ALIKE = np.array([0.0, 0.5, 0.8, 0.3, 0.9, 0.6])
SURE = np.diag(np.repeat([0.001, 0.01], 3) ** 2)


def some_steps(numbers: list[int], seed: int = 5) -> list[Step]:
    """Measured with covariances that tie all six numbers."""
    rng = np.random.default_rng(seed)
    return [
        Step(k, USUAL + np.sqrt(VARIED) * rng.standard_normal(6), random_covariance(rng, 0.02, 0.2)) for k in numbers
    ]


def by_regression(
    steps: list[Step], k: int, times: np.ndarray, surveys: np.ndarray, unit: float
) -> tuple[np.ndarray, np.ndarray]:
    """The twin: mean and variances of step k by Gaussian process regression with all others, one large matrix."""
    others = [step for step in steps if step.k != k and surveys[step.k] == surveys[k]]
    middle = (times[1:] + times[:-1]) / 2 / unit

    def shared(a: int, b: int) -> np.ndarray:
        return np.diag(VARIED * ALIKE ** abs(middle[a] - middle[b]))

    among = np.block([[shared(a.k, b.k) + (a.covariance if a is b else 0) for b in others] for a in others])
    across = np.hstack([shared(k, b.k) for b in others])
    away = np.concatenate([step.rate - USUAL for step in others])
    gain = across @ np.linalg.inv(among)
    return USUAL + gain @ away, np.diag(np.diag(VARIED) - gain @ across.T)


@pytest.mark.parametrize("gaps", [np.ones(9), np.array([1.0, 2.0, 0.5, 1.0, 4.0, 1.0, 1.0, 0.25, 1.0])])
def test_both_filters_tell_what_the_regression_by_all_other_steps_does(gaps: np.ndarray) -> None:
    times, surveys = np.concatenate([[3.0], 3.0 + np.cumsum(gaps)]), np.array([0] * 6 + [1] * 4)
    steps = some_steps([0, 1, 3, 4, 7, 8])
    rates, variances = rates_by_others(steps, USUAL, VARIED, ALIKE, times, surveys)
    unit = float(np.median(np.delete(gaps, 5)))
    for k in (0, 1, 2, 3, 4, 6, 7, 8):
        rate, variance = by_regression(steps, k, times, surveys, unit)
        np.testing.assert_allclose(rates[k], rate, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(variances[k], variance, rtol=1e-9)

    # without steps the motion is the usual one
    rates, variances = rates_by_others([], USUAL, VARIED, ALIKE, np.arange(4.0), np.zeros(4, int))
    np.testing.assert_allclose(rates, np.tile(USUAL, (3, 1)))
    np.testing.assert_allclose(variances, np.tile(VARIED, (3, 1)))


def test_likeness_of_steps_in_a_row_is_found() -> None:
    rng, count = np.random.default_rng(8), 800
    away = np.zeros((count, 6))
    for k in range(count):
        fresh = np.sqrt(VARIED) * rng.standard_normal(6)
        away[k] = fresh if k == 0 else ALIKE * away[k - 1] + np.sqrt(1 - ALIKE**2) * fresh
    steps = [Step(k, USUAL + away[k], 1e-3 * np.diag(VARIED)) for k in range(count)]
    surveys = np.zeros(count + 1, int)
    np.testing.assert_allclose(likeness(steps, away.var(axis=0), surveys), ALIKE, atol=0.1)
    # steps of different surveys are not in a row, and what is not known says nothing
    np.testing.assert_array_equal(likeness(steps, VARIED, np.arange(count + 1)), 0)
    unknown = [Step(step.k, step.rate, 9 * np.diag(VARIED)) for step in steps]
    np.testing.assert_array_equal(likeness(unknown, VARIED, surveys), 0)


def drifting(count: int = 40) -> list[RigidTransform]:
    """Steps of 2 m, of which the vehicle looks aside by an angle that swings: by 29 degrees at most, over 40 steps."""
    aside = 0.5 * np.sin(2 * np.pi * np.arange(count) / 40)
    shifts = 2.0 * np.column_stack([np.cos(aside), np.sin(aside), np.zeros(count)])
    return [
        RigidTransform.from_components(shift, Rotation.from_rotvec([0.0, 0.0, 0.02 * np.cos(k)]))
        for k, shift in enumerate(shifts)
    ]


def test_along_a_wall_a_vehicle_goes_on_as_it_did_and_as_far() -> None:
    """Steps 6 to 13 see one wall, 30 degrees off ahead: how far they lead along it, the scans do not tell at all."""
    true, bare = drifting(), range(6, 14)
    along = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0])
    pairs = []
    for k, T in enumerate(true):
        given = registration(T, SURE, accepted=k not in bare)
        if k in bare:
            in_source = T.rotation.inv().apply(along)
            open_along = SURE + np.pad(np.outer(in_source, in_source) * 50.0**2, (3, 0))
            given = registration(RigidTransform.from_translation(-1.5 * along) * T, open_along, accepted=False)
        pairs.append(RegisteredPair(Candidate(k, k + 1, "sequential"), given))
    motion = learned(pairs)
    for k in bare:
        held = with_motion([pairs[k]], motion)[0].registration
        assert held is not None
        off = rate_of(held.T_target_source)[3:] - rate_of(true[k])[3:]
        assert abs(off @ along) < 0.15
        assert np.linalg.norm(off) < 3 * np.sqrt(np.trace(held.covariance[3:, 3:]))
    # the usual step alone, which looks straight ahead, is off by three times as much
    assert abs((motion.usual[3:] - true[10].translation) @ along) > 0.4


def test_a_sonar_that_stands_still_is_expected_there() -> None:
    motion = learned([step_pair(k, RigidTransform.identity(), SURE) for k in range(9)])
    expected = motion.expected(4, 5)
    np.testing.assert_array_equal(expected.translation, 0)
    np.testing.assert_allclose(expected.sigmas[3:], FLOOR[3:], rtol=1e-3)


def test_a_vehicle_nearly_at_rest_has_no_way_to_go() -> None:
    """A hovering vehicle jitters anywhere: the length of its steps holds no direction."""
    rng = np.random.default_rng(4)
    jitter = RigidTransform.from_translation(0.02 * rng.standard_normal((20, 3)))
    motion = learned([step_pair(k, T, SURE) for k, T in enumerate(jitter)])
    loose = SURE + np.diag([0, 0, 0, 9.0, 0, 0])
    held = with_motion([step_pair(4, RigidTransform.identity(), loose)], motion)[0].registration
    assert held is not None
    assert held.covariance[3, 3] == pytest.approx(motion.expected(4, 5).sigmas[3] ** 2, rel=0.05)
    assert np.linalg.norm(held.T_target_source.translation) < 0.02
