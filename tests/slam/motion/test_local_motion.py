"""How a vehicle moves at a time, and a second look at doubtful pairs with the motion as a measurement."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.motion.local_motion import Step, likeness, rates_by_others
from sonarmap.slam.motion.reconsider import expected_by, is_doubtful, with_both, with_motion, without_unreachable
from sonarmap.slam.pair import RegisteredPair, Role
from sonarmap.spectral.result import Registration
from tests.samples.surveys import chain_edges, chained_graph, random_covariance, registration, ring_poses, step_pair
from tests.slam.motion.test_motion import FLOOR, USUAL, learned, moved, steps

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


def test_refused_or_contradicted_pair_is_doubtful() -> None:
    assert not is_doubtful(pair(answer(moved(USUAL), 0.95, accepted=True)), MOTION)
    assert is_doubtful(pair(answer(moved(USUAL), 0.5)), MOTION)
    assert is_doubtful(pair(answer(JUMP, 0.95, accepted=True)), MOTION)
    assert not is_doubtful(pair(None), MOTION)


@pytest.mark.parametrize(("probability", "doubtful"), [(0.06, True), (1e-9, False)])
def test_what_is_accepted_is_doubtful_where_another_answer_is_more_probable_with_the_motion(
    probability: float, doubtful: bool
) -> None:
    """Among tiles or pipes of equal shape the scans may prefer one that the vehicle hardly reaches."""
    far = answer(moved(USUAL + np.array([0, 0, 0, 0.6, 0, 0])), 0.86, accepted=True)
    assert not is_doubtful(pair(far), MOTION)
    both = replace(far, alternatives=(answer(moved(USUAL), probability),))
    assert is_doubtful(pair(both), MOTION) == doubtful


def test_second_registration_leads_and_first_becomes_an_alternative() -> None:
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


def test_motion_constrains_the_direction_that_scans_do_not() -> None:
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


@pytest.mark.parametrize(
    ("role", "place", "accepted"), [("sequential", 0.95, True), ("sequential", 0.5, False), ("loop", 0.95, False)]
)
def test_step_refused_for_an_unconstrained_direction_is_accepted_with_the_motion(
    role: Role, place: float, accepted: bool
) -> None:
    """A survey along a wall may have no other steps."""
    loose = TIGHT + np.diag([0, 0, 0, 9.0, 0, 0])
    along = replace(registration(moved(USUAL), loose, accepted=False), probability=place, evidence=(("fixed", 0.1),))
    step = with_motion([replace(pair(along), role=role)], MOTION)[0]
    assert step.accepted == accepted


def test_motion_hardly_changes_a_certain_registration() -> None:
    T = moved(USUAL) * RigidTransform.from_exp_coords([0.01, 0.02, -0.03, 0.1, 0.05, -0.1])
    held = with_usual(registration(T, TIGHT))
    moved_by = (T.inv() * held.T_target_source).as_exp_coords()
    assert moved_by @ np.linalg.solve(TIGHT, moved_by) < 0.2
    # information adds: never less sure than by either alone
    assert np.linalg.eigvalsh(TIGHT - held.covariance).min() > -1e-12
    # a jump is left as it is
    assert with_usual(answer(JUMP, 0.9, accepted=True)).T_target_source is JUMP


def test_hypotheses_out_of_reach_are_dropped() -> None:
    far = moved(np.array([0, 0, 0.1, 60.0, 0, 0]))
    given = replace(answer(far, 0.95, accepted=True), alternatives=(answer(far, 0.02), answer(moved(USUAL), 0.03)))
    left = without_unreachable(pair(given), MOTION).registration
    assert left is not None
    assert not left.accepted
    assert left.probability == 0
    assert "cannot have come so far" in left.reason
    assert [one.probability for one in left.alternatives] == [0.03]
    near = without_unreachable(pair(answer(moved(USUAL), 0.95, accepted=True)), MOTION).registration
    assert near is not None
    assert near.accepted


SURE = np.diag(np.repeat([0.001, 0.01], 3) ** 2)


ALIKE = np.array([0.0, 0.5, 0.8, 0.3, 0.9, 0.6])


VARIED = np.array([0.02, 0.01, 0.1, 0.2, 0.4, 0.05]) ** 2


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


def some_steps(numbers: list[int], seed: int = 5) -> list[Step]:
    """Measured with covariances that tie all six numbers."""
    rng = np.random.default_rng(seed)
    return [
        Step(k, USUAL + np.sqrt(VARIED) * rng.standard_normal(6), random_covariance(rng, 0.02, 0.2)) for k in numbers
    ]


def test_standing_sonar_is_expected_at_the_same_place() -> None:
    motion = learned([step_pair(k, RigidTransform.identity(), SURE) for k in range(9)])
    expected = motion.expected(4, 5)
    np.testing.assert_array_equal(expected.T_target_source.translation, 0)
    np.testing.assert_allclose(expected.sigmas[3:], FLOOR[3:], rtol=1e-3)


def test_distance_constrains_no_direction_of_a_hovering_vehicle() -> None:
    """A hovering vehicle jitters anywhere: the length of its steps holds no direction."""
    rng = np.random.default_rng(4)
    jitter = RigidTransform.from_translation(0.02 * rng.standard_normal((20, 3)))
    motion = learned([step_pair(k, T, SURE) for k, T in enumerate(jitter)])
    loose = SURE + np.diag([0, 0, 0, 9.0, 0, 0])
    held = with_motion([step_pair(4, RigidTransform.identity(), loose)], motion)[0].registration
    assert held is not None
    assert held.covariance[3, 3] == pytest.approx(motion.expected(4, 5).sigmas[3] ** 2, rel=0.05)
    assert np.linalg.norm(held.T_target_source.translation) < 0.02


@pytest.mark.parametrize("gaps", [np.ones(9), np.array([1.0, 2.0, 0.5, 1.0, 4.0, 1.0, 1.0, 0.25, 1.0])])
def test_both_filters_equal_regression_by_all_other_steps(gaps: np.ndarray) -> None:
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


def test_likeness_is_the_correlation_of_consecutive_steps() -> None:
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


def test_expected_pose_is_the_estimates_with_three_times_its_variance() -> None:
    poses = ring_poses(6)
    solution = chained_graph(chain_edges(poses, TIGHT), 6).optimize()
    floor = np.repeat([0.01, 0.05], 3)
    (expected,) = expected_by(solution, [RegisteredPair(1, 4, "loop")], floor)
    T = expected.T_target_source.inv() * poses[1].inv() * poses[4]
    np.testing.assert_allclose(T.as_matrix(), np.eye(4), atol=1e-4)
    covariance = solution.relative(1, 4)[1]
    R = expected.T_target_source.rotation.as_matrix()
    np.testing.assert_allclose(expected.sigmas[3:] ** 2, 3 * np.diag(R @ covariance[3:, 3:] @ R.T) + 0.05**2, rtol=1e-3)


def test_scaling_an_edge_scales_only_the_covariance_by_scans() -> None:
    """Scaling an edge scales the scans' part alone: as if the motion held what the scans say with that covariance.

    But for the direction of the way, in which its length is known: it follows where the scans and the motion lead.
    """
    near = moved(USUAL) * RigidTransform.from_exp_coords([0.01, -0.02, 0.01, 0.1, 0.2, -0.1])
    loose = TIGHT + np.diag([0, 0, 0, 4.0, 0, 0])

    def fused(covariance: np.ndarray) -> Edge:
        return Edge(5, 6, with_usual(registration(near, covariance)), "sequential")

    for factor in (0.1, 1.0, 7.0):
        told = fused(loose).scaled(factor / 2).scaled(2.0).registration
        direct = fused(factor * loose).registration
        np.testing.assert_allclose(told.covariance, direct.covariance, rtol=0.02, atol=1e-9)
        off: np.ndarray = (told.T_target_source.inv() * direct.T_target_source).as_exp_coords()
        assert off @ np.linalg.solve(direct.covariance, off) < 0.02**2
    whole, tenth = fused(loose).registration, fused(loose).scaled(0.1).registration
    assert tenth.covariance[3, 3] > 0.5 * whole.covariance[3, 3]


def test_retry_about_an_estimate_includes_the_covariance_of_the_expected_pose() -> None:
    first, second = pair(answer(JUMP, 0.5)), replace(pair(answer(moved(USUAL), 0.9)), expected=EXPECTED)
    assert first.registration is not None
    assert second.registration is not None
    both = with_both(first, second).registration
    assert both is not None
    widened = both.covariance - second.registration.covariance
    window = (EXPECTED.sigmas[3:] ** 2).sum()  # the second answer is wrong with a probability of a tenth
    assert 0.1 * window < np.trace(widened[3:, 3:]) < 0.15 * window
    # about the usual motion the steps themselves are weighed
    by_motion = with_both(first, second, MOTION).registration
    assert by_motion is not None
    np.testing.assert_array_equal(by_motion.covariance, second.registration.covariance)
