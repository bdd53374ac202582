"""What registrations amount to: gaps closed, the chain corrected, false loops left out, twins believed less."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.decide.decision import Decision, decide
from sonarmap.slam.pair import RegisteredPair, Role
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.surveys import drawn, measurements_of, random_covariance, registration, ring_poses

COVARIANCE = random_covariance(np.random.default_rng(1), 0.002, 0.02)
VOXEL = 0.1
WRONG = RigidTransform.from_exp_coords([0, 0, 0.6, 4, -1, 0])


def pair(
    truth: RigidTransform, i: int, j: int, role: Role, off: RigidTransform | None = None, **changes
) -> RegisteredPair:
    noise = drawn(np.random.default_rng([i, j]), COVARIANCE)
    T = truth[i].inv() * truth[j] * noise * (RigidTransform.identity() if off is None else off)
    return RegisteredPair(i, j, role, registration=replace(registration(T, COVARIANCE), **changes))


def unsure(probability: float, *alternatives: Registration) -> dict:
    return {"accepted": False, "probability": probability, "reason": "not sure", "alternatives": alternatives}


def chain_of(truth: RigidTransform, **changed: dict) -> list[RegisteredPair]:
    """Consecutive scans; changed["k3"] holds what is different about (3, 4)."""
    return [pair(truth, k, k + 1, "sequential", **changed.get(f"k{k}", {})) for k in range(len(truth) - 1)]


def decided(truth: RigidTransform, pairs: list[RegisteredPair]) -> Decision:
    return decide(pairs, measurements_of(len(truth)), VOXEL, LoopSettings())


def worst(result: Decision, truth: RigidTransform) -> float:
    T = result.solution.trajectory.T_world_sensor
    return float(np.linalg.norm((T[0].inv() * T).translation - truth.translation, axis=1).max())


def test_doubtful_step_is_kept_if_another_pair_agrees():
    truth = ring_poses(12)
    gap = chain_of(truth, k5=unsure(0.8))
    alone = decided(truth, gap)
    assert alone.solution.graph.components == (tuple(range(6)), tuple(range(6, 12)))
    assert alone.pairs[5].reason.startswith("refused by the registration: not sure")
    joined = decided(truth, [*gap, pair(truth, 4, 7, "bridge", **unsure(0.8))])
    assert len(joined.solution.graph.components) == 1
    assert all(p.kept for p in joined.pairs)
    assert "though the registration was not sure (80%)" in joined.pairs[5].reason
    assert worst(joined, truth) < 0.3
    apart = decided(truth, [*gap, pair(truth, 4, 7, "bridge", WRONG, **unsure(0.8))])
    assert len(apart.solution.graph.components) == 2
    faint = decided(truth, [*gap, pair(truth, 4, 7, "bridge", **unsure(0.6))])
    assert len(faint.solution.graph.components) == 2


def test_alternative_is_kept_if_other_pairs_agree():
    """A place that looks alike from both sides: the more probable answer is the wrong one."""
    truth = ring_poses(12)
    right = pair(truth, 2, 9, "loop", **unsure(0.4)).registration
    assert right is not None
    wrong = replace(right, T_target_source=right.T_target_source * WRONG, probability=0.55, alternatives=(right,))
    pairs = [*chain_of(truth), RegisteredPair(2, 9, "loop", registration=wrong), pair(truth, 1, 10, "loop")]
    doubtful = decided(truth, pairs).pairs[11]
    assert doubtful.edge is not None
    np.testing.assert_array_equal(
        doubtful.edge.registration.T_target_source.as_matrix(), right.T_target_source.as_matrix()
    )
    assert "answer 2" in doubtful.reason


def test_two_loops_or_one_bridge_join_components():
    truth = ring_poses(12)
    gap = chain_of(truth, k5=unsure(0.0))
    one = decided(truth, [*gap, pair(truth, 1, 10, "loop")])
    assert len(one.solution.graph.components) == 2
    assert "no other pair agrees" in one.pairs[-1].reason
    two = decided(truth, [*gap, pair(truth, 1, 10, "loop"), pair(truth, 2, 9, "loop")])
    assert len(two.solution.graph.components) == 1
    bridge = decided(truth, [*gap, pair(truth, 4, 7, "bridge")])
    assert len(bridge.solution.graph.components) == 1


def test_accepted_wrong_step_is_rejected_by_its_neighbors():
    truth = ring_poses(14)
    loops = [pair(truth, i, j, "loop") for i, j in ((5, 7), (6, 8), (4, 8), (0, 13))]
    result = decided(truth, [*chain_of(truth, k6={"off": WRONG}), *loops])
    assert not result.pairs[6].kept
    assert result.pairs[6].reason.startswith("refused, inconsistent")
    assert result.pairs[6].residual > 10
    assert all(p.kept for p in result.pairs[13:])
    assert worst(result, truth) < 0.3


def test_false_loops_that_agree_with_each_other_do_not_break_the_chain():
    """A place that looks like another, from several scans in a row."""
    truth = ring_poses(24)
    pairs = [*chain_of(truth), pair(truth, 0, 23, "loop"), pair(truth, 1, 22, "loop")]
    for i, j in ((3, 15), (4, 16), (5, 17)):
        looks = truth[i].inv() * truth[3] * truth[15].inv() * truth[j]
        off = (truth[i].inv() * truth[j]).inv() * looks
        pairs.append(pair(truth, i, j, "loop", off))
    result = decided(truth, pairs)
    assert [p.kept for p in result.pairs[-5:]] == [True, True, False, False, False]
    assert all(p.kept for p in result.pairs[:23])
    assert result.pairs[-1].agreeing == 2
    assert worst(result, truth) < 0.3


def test_order_does_not_matter():
    truth = ring_poses(12)
    more = pair(truth, 4, 7, "bridge", **unsure(0.6)), pair(truth, 0, 11, "loop")
    pairs = [*chain_of(truth, k5=unsure(0.7)), *more]
    one, other = decided(truth, pairs), decided(truth, pairs[::-1])
    difference = one.solution.trajectory.T_world_sensor.inv() * other.solution.trajectory.T_world_sensor
    assert difference.as_exp_coords() == pytest.approx(np.zeros((12, 6)), abs=1e-5)
    assert [p.reason for p in one.pairs] == [p.reason for p in other.pairs[::-1]]


def open_along(
    truth: RigidTransform, i: int, j: int, place: float, off: RigidTransform | None = None
) -> RegisteredPair:
    """A loop along a wall: 1.5 m off along it, by a covariance that says so; refused for that."""
    slid = RigidTransform.from_translation([1.5, 0, 0])
    off = slid if off is None else off * slid
    given = pair(truth, i, j, "loop", off, **unsure(place), evidence=(("fixed", 0.02),))
    assert given.registration is not None
    loose = COVARIANCE + np.diag([0, 0, 0, 25.0, 0, 0])
    return replace(given, registration=replace(given.registration, covariance=loose))


@pytest.mark.slow
def test_loop_with_unconstrained_direction_constrains_the_others():
    truth = ring_poses(12)
    pairs = [*chain_of(truth), pair(truth, 0, 11, "loop"), pair(truth, 1, 10, "loop")]
    taken = decided(truth, [*pairs, open_along(truth, 2, 9, 0.95)])
    assert taken.pairs[-1].kept
    assert worst(taken, truth) < 0.3
    assert not decided(truth, [*pairs, open_along(truth, 2, 9, 0.5)]).pairs[-1].kept
    aside = RigidTransform.from_translation([0, 3.0, 0])
    assert not decided(truth, [*pairs, open_along(truth, 2, 9, 0.95, aside)]).pairs[-1].kept
    elsewhere = decided(truth, [*pairs, open_along(truth, 2, 9, 0.95, RigidTransform.from_translation([1.5, 0, 0]))])
    assert "far from where the chain does" in elsewhere.pairs[-1].reason
    # it joins nothing
    gap = [*chain_of(truth, k5=unsure(0.0)), pair(truth, 1, 10, "loop")]
    result = decided(truth, [*gap, open_along(truth, 2, 9, 0.95), open_along(truth, 3, 8, 0.95)])
    assert len(result.solution.graph.components) == 2


@pytest.mark.slow
def test_chi_squared_before_is_that_of_the_chained_poses():
    truth = ring_poses(24)
    result = decided(truth, [*chain_of(truth), pair(truth, 0, 23, "loop"), pair(truth, 2, 20, "loop")])
    graph = result.solution.graph
    assert result.solution.chi_squared_before == pytest.approx(graph.at(result.chained.T_world_sensor).chi_squared)
    assert result.solution.chi_squared_before > 2 * result.solution.chi_squared_after


def test_wrong_fixes_in_a_row_yield_to_loops() -> None:
    """Three lanes of ten scans; with sigmas of 1 m two steps alone would yield to ten fixes that are off alike."""
    lane, rng, unsure = np.arange(30) // 10, np.random.default_rng(5), np.diag(np.repeat([0.01, 1.0], 3) ** 2)
    back = lane % 2 == 1
    along = np.where(back, 9 - np.arange(30) % 10, np.arange(30) % 10)
    places, headings = np.column_stack([9.0 * along, 12.0 * lane, np.zeros(30)]), np.where(back, np.pi, 0.0)
    truth = RigidTransform.from_components(places, Rotation.from_euler("Z", headings[:, None]))
    loops = [(i, j) for i in range(30) for j in range(i + 2, 30) if along[i] == along[j] and lane[j] == lane[i] + 1]
    pairs = [
        pair(truth, i, j, "sequential" if j == i + 1 else "loop", drawn(rng, unsure), covariance=unsure)
        for i, j in [*((k, k + 1) for k in range(29)), *loops]
    ]
    fixes = places + rng.normal(size=(30, 3)) * [0.5, 0.5, 0.1]
    fixes[5:15] += [20.0, -12.0, 0.0]
    T = RigidTransform.from_components(fixes, truth.rotation)
    sigmas, point = np.array([0.005, 0.005, 0.02, 0.5, 0.5, 0.1]), np.ones((1, 3), np.float32)
    scans = tuple(Scan(point, prior=PosePrior(each, sigmas), stamp=float(k)) for k, each in enumerate(T))
    result = decide(pairs, replace(measurements_of(30), scans=scans), 1.0, LoopSettings())
    assert {fix.scan for fix in result.fixes.wrong} == set(range(5, 15))
    assert all(each.kept for each in result.pairs)
