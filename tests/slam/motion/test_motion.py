"""The usual motion, learned from steps that are sure, and dead reckoning: what they expect and contradict."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.motion.limits import MotionLimits
from sonarmap.slam.motion.measured_motion import MeasuredMotion
from sonarmap.slam.motion.motion import Motion
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.pair import RegisteredPair
from tests.samples.surveys import chained_graph, registration, ring_poses, step_pair

COVARIANCE = np.diag(np.repeat([0.001, 0.01], 3) ** 2)
FLOOR = np.repeat([0.017, 0.1], 3)
USUAL = np.array([0.01, -0.02, 0.15, 1.5, 0.2, -0.1])
SPREAD = np.array([0.01, 0.01, 0.08, 0.2, 0.1, 0.05])


def moved(x: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components(x[3:], Rotation.from_rotvec(x[:3]))


def steps(
    count: int, wrong: int = 0, seed: int = 3, spans: np.ndarray | None = None, spread: np.ndarray = SPREAD
) -> list[RegisteredPair]:
    """Consecutive pairs, of which the first few are turned half around and far away."""
    rng = np.random.default_rng(seed)
    spans = np.ones(count) if spans is None else spans
    pairs = []
    for k in range(count):
        x = (USUAL + spread * rng.standard_normal(6)) * spans[k]
        T = moved(x) if k >= wrong else moved(np.array([0.1, 0, 3.0, -18.0, 11.0, 0.5]))
        pairs.append(step_pair(k, T, COVARIANCE))
    return pairs


def learned(pairs: list[RegisteredPair], stamps: np.ndarray | None = None) -> Motion:
    count = len(pairs) + 1
    stamps = np.arange(count, dtype=float) if stamps is None else stamps
    motion = Motion.learn(pairs, stamps, np.zeros(count, int), FLOOR)
    assert motion is not None
    return motion


@pytest.mark.parametrize("wrong", [0, 4])
def test_few_wrong_steps_do_not_change_the_learned_motion(wrong: int) -> None:
    motion = learned(steps(40, wrong))
    assert (np.abs(motion.usual - USUAL) < 4 * SPREAD / np.sqrt(36)).all()
    deviation = np.sqrt(np.diag(motion.covariance))
    assert (deviation[3:] > 0.6 * SPREAD[3:]).all()
    assumed = np.sqrt(4 / 40) * np.repeat([np.radians(20.0), np.linalg.norm(USUAL[3:]) / np.sqrt(3)], 3)
    assert (deviation < 1.3 * np.hypot(SPREAD, assumed)).all()


def test_steps_far_from_the_usual_motion_are_contradicted() -> None:
    motion = learned(steps(40, wrong=2))
    for pair in steps(40, seed=4):
        assert pair.registration is not None
        assert not motion.contradicts(*pair.scans, pair.registration.T_target_source)
    assert motion.contradicts(0, 1, moved(np.array([0.1, 0, 3.0, -18.0, 11.0, 0.5])))
    assert motion.contradicts(0, 1, moved(USUAL * [1, 1, 1, -6, 1, 1]))


def test_expected_distance_grows_with_the_time_between_stamps() -> None:
    spans = np.tile([1.0, 2.0, 0.5, 4.0], 10)
    stamps = 1e9 + np.concatenate([[0.0], np.cumsum(spans)])
    motion = learned(steps(40, spans=spans, spread=0 * SPREAD), stamps)
    short, long = motion.expected(2, 3), motion.expected(3, 4)
    np.testing.assert_allclose(long.T_target_source.translation, 8 * short.T_target_source.translation, rtol=1e-4)
    assert (long.sigmas > short.sigmas).all()
    over_a_gap = motion.expected(0, 4)
    np.testing.assert_allclose(over_a_gap.T_target_source.translation, 7.5 * motion.usual[3:], atol=1e-5)


def test_equal_stamps_are_ignored_and_few_steps_give_no_motion() -> None:
    np.testing.assert_array_equal(learned(steps(20), np.full(21, 5.0)).usual, learned(steps(20)).usual)
    assert Motion.learn(steps(3), np.arange(4.0), np.zeros(4, int), FLOOR) is None
    refused = [step_pair(k, moved(USUAL), COVARIANCE, accepted=False) for k in range(20)]
    assert Motion.learn(refused, np.arange(21.0), np.zeros(21, int), FLOOR) is None


def test_limits_bound_expected_and_accepted_steps() -> None:
    limits = MotionLimits(step=1.0, turn_rate=0.3)
    motion = Motion.learn([], np.arange(6.0), np.zeros(6, int), FLOOR, limits)
    assert motion is not None
    expected = motion.expected(0, 2)
    np.testing.assert_array_equal(expected.T_target_source.translation, 0)
    np.testing.assert_allclose(expected.sigmas[3:], np.hypot(2.0 / 3, FLOOR[3]), rtol=1e-4)
    np.testing.assert_allclose(expected.sigmas[:3], np.hypot(0.6 / 3, FLOOR[0]), rtol=1e-4)
    assert not motion.contradicts(0, 1, moved(np.array([0, 0, 0.2, 0.9, 0, 0])))
    assert motion.contradicts(0, 1, moved(np.array([0, 0, 0.2, 1.6, 0, 0])))
    assert motion.contradicts(0, 1, moved(np.array([0, 0, 0.6, 0.9, 0, 0])))
    # steps beyond them are not learned from
    pairs = [*steps(6), *steps(40, wrong=12)[6:12]]
    motion = Motion.learn(pairs, np.arange(13.0), np.zeros(13, int), FLOOR, MotionLimits(speed=4.0))
    assert motion is not None
    assert np.linalg.norm(motion.usual - USUAL) < 0.5


def test_limits_of_zero_or_nan_are_refused() -> None:
    for given in (0.0, float("nan")):
        with pytest.raises(InputError, match="more than 0"):
            MotionLimits(speed=given)


POSES = ring_poses(30)
WORLD = RigidTransform.from_exp_coords([0.2, -0.1, 2.0, 40.0, -30.0, 5.0])
FINE = np.repeat([0.01, 0.05], 3)
TIMES = 100.0 + 2.0 * np.arange(30)
ODOMETRY = Odometry(np.arange(30), WORLD * POSES, TIMES, drift=0.02, turn_drift=0.001)


def test_odometry_error_grows_with_distance_and_time() -> None:
    expected, T = ODOMETRY.expected(3, 9, FINE), POSES[3].inv() * POSES[9]
    np.testing.assert_allclose(expected.T_target_source.as_matrix(), T.as_matrix(), atol=1e-5)
    way = np.linalg.norm(np.diff(POSES.translation[3:10], axis=0), axis=1).sum()
    turn = 0.001 * 12.0
    sigmas = expected.sigmas
    np.testing.assert_allclose(sigmas[:3], np.hypot(turn, 0.01), rtol=1e-4)
    np.testing.assert_allclose(sigmas[3:], np.hypot(0.02 * way + turn * way / 2, 0.05), rtol=1e-4)
    # it contradicts what is far off alone
    assert not ODOMETRY.contradicts(3, 9, T * RigidTransform.from_translation([0.4, 0.3, 0.0]), FINE)
    assert ODOMETRY.contradicts(3, 9, T * RigidTransform.from_translation([4.0, 3.0, 0.0]), FINE)
    assert ODOMETRY.contradicts(3, 9, T * RigidTransform.from_exp_coords([0, 0, 0.5, 0, 0, 0]), FINE)


def test_odometry_edges_together_have_the_error_of_the_whole_track() -> None:
    edges = ODOMETRY.edges(np.zeros(30, int))
    assert [edge.kind for edge in edges] == ["odometry"] * 29
    _, covariance = chained_graph(edges, 30).optimize().relative(0, 29)
    way = np.linalg.norm(np.diff(POSES.translation, axis=0), axis=1).sum()
    total = np.sqrt(np.trace(covariance[3:, 3:]) / 3)
    assert 0.02 * way < total < 0.2 * way
    # it joins no surveys and skips what it does not tell
    some = Odometry(np.array([0, 1, 4, 5, 6]), POSES[[0, 1, 4, 5, 6]], TIMES[[0, 1, 4, 5, 6]])
    edges = some.edges(np.array([0, 0, 0, 0, 0, 1, 1]))
    assert [(edge.i, edge.j) for edge in edges] == [(0, 1), (1, 4), (5, 6)]
    assert some.tells(1, 4)
    assert not some.tells(1, 3)


@pytest.mark.parametrize(("stated", "shown"), [(5.0, 5.0), (0.2, 1.0)])
def test_drift_is_scaled_to_what_registrations_show(stated: float, shown: float) -> None:
    """`stated`: how many times too small the drift was said to be."""
    count, rng = 60, np.random.default_rng(12)
    truth, times = ring_poses(count), 100.0 + 2.0 * np.arange(count)
    pairs, reckoned = [], [truth[0]]
    for k in range(count - 1):
        T = truth[k].inv() * truth[k + 1]
        error = rng.standard_normal(6) * np.repeat([0.002, 0.02], 3)
        pairs.append(step_pair(k, T * RigidTransform.from_exp_coords(error), np.diag(np.repeat([0.002, 0.02], 3) ** 2)))
        way = float(np.linalg.norm(T.translation))
        drifting = np.repeat([0.002 * 2.0, 0.03 * way], 3) * [1, -1, 1, 1, 1, -1]
        reckoned.append(reckoned[-1] * T * RigidTransform.from_exp_coords(drifting))
    poses = RigidTransform.concatenate(reckoned)
    odometry = Odometry(np.arange(count), poses, times, drift=0.03 / stated, turn_drift=0.002 / stated)
    told = odometry.as_registered(pairs)
    assert told.understated == pytest.approx(shown, rel=0.4)
    assert told.drift == pytest.approx(told.understated * odometry.drift)
    assert odometry.as_registered(pairs[:12]) is odometry  # too few say nothing
    end = truth[0].inv() * truth[count - 1]
    if stated == 5:  # a loop that the stated drift would have refused
        assert odometry.contradicts(0, count - 1, end, FINE)
    assert not told.contradicts(0, count - 1, end, FINE)


def test_bad_odometry_is_refused() -> None:
    for count, drift, words in ((4, 0.1, "a scan, a pose and a time each"), (5, -0.1, "0 or more")):
        with pytest.raises(InputError, match=words):
            Odometry(np.arange(count), POSES[:5], TIMES[:5], drift=drift)


@pytest.mark.parametrize("seed", range(2))
def test_scans_in_no_order_have_no_usual_motion(seed: int) -> None:
    """Nor has a vehicle that goes to and fro at random; one that stops now and then has."""
    order, rng = np.argsort(np.random.default_rng(seed).random(20)), np.random.default_rng(seed)
    places = [RigidTransform.from_translation([1.5 * k, 0.1 * k, 0.0]) for k in range(20)]
    shuffled = [step_pair(k, places[a].inv() * places[b], COVARIANCE) for k, (a, b) in enumerate(pairwise(order))]
    assert Motion.learn(shuffled, np.arange(20.0), np.zeros(20, int), FLOOR) is None
    stops = [step_pair(k, moved(USUAL * (rng.random() < 0.7)), COVARIANCE) for k in range(19)]
    assert Motion.learn(stops, np.arange(20.0), np.zeros(20, int), FLOOR) is not None


def placed(pairs: list[RegisteredPair], opens: list[int], place: float = 0.95) -> list[RegisteredPair]:
    """Refused registrations that leave one number open each, in turns, and have it anywhere; one is accepted."""
    rng = np.random.default_rng(8)
    result = []
    for k, pair in enumerate(pairs):
        assert pair.registration is not None
        T, n = pair.registration.T_target_source, opens[k % len(opens)]
        x = np.concatenate([T.rotation.as_rotvec(), T.translation])
        sigma = 1.5 if n < 3 else 8.0
        x[n] += sigma / 2 * rng.uniform(-1, 1)
        in_source = np.kron(np.eye(2), moved(x).rotation.as_matrix().T)
        covariance = COVARIANCE + sigma**2 * np.outer(in_source[:, n], in_source[:, n])
        given = registration(moved(x), covariance, accepted=False)
        result.append(replace(pair, registration=replace(given, probability=place, evidence=(("fixed", 0.1),))))
    return [pairs[0], *result[1:]]


def test_rare_turns_widen_the_motion() -> None:
    """A lawnmower goes straight for long, and then turns: the turns are no errors."""
    pairs = steps(40)
    turn = moved(USUAL * [1, 1, 5, 0.6, 1, 1])
    for k in (9, 10, 19, 20, 29, 30):
        pairs[k] = step_pair(k, turn, COVARIANCE)
    motion = learned(pairs)
    assert not motion.contradicts(9, 10, turn)
    assert 4 * motion.expected(9, 10).sigmas[2] > 4 * USUAL[2]


def test_rest_and_transit_have_their_own_rates() -> None:
    """A second under way and 100 s at rest lead as far as the second did, and bridges over either say so."""
    spans = np.array([1.0, 100.0] * 10)
    stamps = 1e9 + np.concatenate([[0.0], np.cumsum(spans)])
    under_way, at_rest = moved(np.array([0, 0, 0, 1.0, 0, 0])), RigidTransform.identity()
    motion = learned([step_pair(k, at_rest if k % 2 else under_way, COVARIANCE) for k in range(20)], stamps)
    for i, j, way in ((0, 2, 1.0), (1, 3, 1.0), (1, 2, 0.0), (2, 3, 1.0)):
        expected = motion.expected(i, j)
        assert abs(expected.T_target_source.translation[0] - way) < 2 * expected.sigmas[3], (i, j)
    rates = np.array([[0, 0, 0, 1.0, 0, 0], np.zeros(6)])
    known = replace(motion, rates=np.tile(rates, (10, 1)), variances=np.full((20, 6), 1e-8))
    np.testing.assert_allclose(known.expected(0, 2).T_target_source.translation, [1, 0, 0], atol=1e-6)


def test_short_steps_of_a_stream_hardly_change_the_speed() -> None:
    """Five steps of a fiftieth of the usual time, whose errors of 5 cm are more than the way."""
    rng = np.random.default_rng(7)
    spans, covariance = np.repeat([0.02, 1.0], [5, 8]), np.diag(np.repeat([0.005, 0.05], 3) ** 2)
    errors = rng.multivariate_normal(np.zeros(6), covariance, len(spans)) * (spans < 1)[:, None]
    pairs = [step_pair(k, moved(USUAL * span + errors[k]), covariance) for k, span in enumerate(spans)]
    motion = learned(pairs, np.concatenate([[0.0], np.cumsum(spans)]))
    speed = float(np.linalg.norm(USUAL[3:]))
    assert motion.speed == pytest.approx(speed, rel=0.05)
    assert (np.abs(motion.usual - USUAL)[3:] < 0.05 * speed).all()


def test_direction_unconstrained_in_all_steps_keeps_the_assumed_spread() -> None:
    motion = learned(placed(steps(40), [4]))
    held = [0, 1, 2, 3, 5]
    assert (np.abs(motion.usual - USUAL)[held] < 4 * SPREAD[held] / np.sqrt(36)).all()
    assert abs(motion.usual[4] - USUAL[4]) < np.sqrt(motion.covariance[4, 4])
    assert motion.covariance[4, 4] > 0.5 * motion.usual[3] ** 2 / 3


def test_steps_with_unconstrained_directions_together_give_the_motion() -> None:
    """Along walls no step may hold all six numbers; together they do."""
    motion = learned(placed(steps(40), [2, 4]))
    assert (np.abs(motion.usual - USUAL) < 6 * SPREAD / np.sqrt(20)).all()
    assert motion.covariance[4, 4] < 0.6**2
    assert Motion.learn(placed(steps(40), [2, 4], 0.4), np.arange(41.0), np.zeros(41, int), FLOOR) is None


def test_learned_motion_is_used_where_dead_reckoning_ends() -> None:
    pairs, far = steps(20), RigidTransform.from_translation([500.0, 0, 0])
    learned_motion = learned(pairs)
    motion = MeasuredMotion(Odometry(np.arange(10), POSES[:10], TIMES[:10]), learned_motion, FINE)
    assert motion.way(3, 4) is None
    assert motion.way(14, 15) == learned_motion.way(14, 15)
    fewer = motion.following(pairs[:15]).expected(16, 17)
    np.testing.assert_array_equal(fewer.sigmas, learned_motion.following(pairs[:15]).expected(16, 17).sigmas)
    assert (fewer.sigmas >= (1 - 1e-9) * motion.expected(16, 17).sigmas).all()
    unlearned = MeasuredMotion(motion.odometry, None, FINE)
    assert [unlearned.is_measured(3, k) for k in (4, 14)] == [True, False]
    assert unlearned.expected(3, 14).sigmas.min() > 3
    assert not unlearned.contradicts(3, 14, far)
    assert unlearned.is_beyond(3, 4, far)
    assert unlearned.way(14, 15) is None
    assert unlearned.following(pairs) is unlearned
