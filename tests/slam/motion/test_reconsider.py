"""A second look at doubtful pairs, and the motion as a measurement."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.edge import Edge, scaled
from sonarmap.slam.motion.reconsider import expected_by, is_doubtful, with_both, with_motion, without_leaps
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.result import Registration
from tests.samples.surveys import chain_edges, chained_graph, random_covariance, registration, ring_poses
from tests.slam.motion.test_motion import USUAL, learned, moved, steps

MOTION = learned(steps(40))
EXPECTED = MOTION.expected(5, 6)
TIGHT = random_covariance(np.random.default_rng(3), 0.002, 0.01)
JUMP = moved(np.array([0.1, 0, 3.0, -18.0, 11.0, 0.5]))


def answer(T: RigidTransform, probability: float, accepted: bool = False) -> Registration:
    return replace(registration(T, TIGHT, accepted), probability=probability)


def pair(given: Registration | None) -> RegisteredPair:
    return RegisteredPair(Candidate(5, 6, "sequential"), given)


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
    second = pair(answer(moved(1.1 * USUAL), 0.8))
    second = replace(second, candidate=replace(second.candidate, expected=EXPECTED))
    both = with_both(first, second, MOTION)
    assert both.registration is not None
    assert both.registration.probability == 0.8
    assert both.candidate.expected is EXPECTED
    jump, usual = both.registration.alternatives
    assert jump.probability == pytest.approx(0.9 * 0.2 * 0.1)
    assert usual.probability == pytest.approx(0.1 * 0.2)
    assert not jump.accepted
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


def test_the_motion_is_no_surer_where_registrations_agree_better() -> None:
    """Scaling an edge scales the scans' part alone: as if the motion held what the scans say with that covariance.

    But for the direction of the way, in which its length is known: it follows where the scans and the motion lead.
    """
    near = moved(USUAL) * RigidTransform.from_exp_coords([0.01, -0.02, 0.01, 0.1, 0.2, -0.1])
    loose = TIGHT + np.diag([0, 0, 0, 4.0, 0, 0])

    def fused(covariance: np.ndarray) -> Edge:
        return Edge(5, 6, with_usual(registration(near, covariance)), "sequential")

    for factor in (0.1, 1.0, 7.0):
        (twice,) = scaled(scaled([fused(loose)], factor / 2), 2.0)
        told, direct = twice.registration, fused(factor * loose).registration
        np.testing.assert_allclose(told.covariance, direct.covariance, rtol=0.02, atol=1e-9)
        off: np.ndarray = (told.T_target_source.inv() * direct.T_target_source).as_exp_coords()
        assert off @ np.linalg.solve(direct.covariance, off) < 0.02**2
    assert (
        scaled([fused(loose)], 0.1)[0].registration.covariance[3, 3] > 0.5 * fused(loose).registration.covariance[3, 3]
    )


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


def test_the_estimate_expects_a_pair_where_it_has_it() -> None:
    poses = ring_poses(6)
    solution = chained_graph(chain_edges(poses, TIGHT), 6).optimize()
    floor = np.repeat([0.01, 0.05], 3)
    (expected,) = expected_by(solution, [RegisteredPair(Candidate(1, 4, "loop"))], floor)
    T = expected.T_target_source.inv() * poses[1].inv() * poses[4]
    np.testing.assert_allclose(T.as_matrix(), np.eye(4), atol=1e-4)
    covariance = solution.relative(1, 4)[1]
    R = Rotation.from_rotvec(expected.rotation).as_matrix()
    np.testing.assert_allclose(expected.sigmas[3:] ** 2, 3 * np.diag(R @ covariance[3:, 3:] @ R.T) + 0.05**2, rtol=1e-3)
