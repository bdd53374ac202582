"""Where a survey's places look alike, its registrations are believed less."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.decide.possible_edge import PossibleEdge, Support
from sonarmap.slam.decide.twins import twin_odds, with_odds
from sonarmap.slam.pair import RegisteredPair
from tests.samples.surveys import registration, ring_poses
from tests.slam.decide.test_decision import COVARIANCE, chain_of, decided, pair, unsure, worst

INSIDE, CONTRADICTING, JOINING = Support(sigmas=0.5, agrees=True), Support(sigmas=30.0), Support()


def answers(support: Support, count: int, accepted: bool = True) -> list[PossibleEdge]:
    """Accepted ones without a probability count as right with 90 %."""
    given = registration(RigidTransform.identity(), COVARIANCE, accepted)
    return [PossibleEdge(k, k + 9, given, support=support) for k in range(count)]


def test_odds_are_what_loops_within_a_part_show() -> None:
    assert twin_odds([]) == 1
    # five of fifty are wrong as told, and thirty would be six times as many: less so while few have been judged
    assert twin_odds([*answers(INSIDE, 45), *answers(CONTRADICTING, 5)]) == pytest.approx(1)
    assert twin_odds([*answers(INSIDE, 20), *answers(CONTRADICTING, 30)]) == pytest.approx(32 / 7)
    assert twin_odds(answers(CONTRADICTING, 1)) == pytest.approx(3 / 2.1)
    # a survey without twins is not believed more than registrations say
    assert twin_odds(answers(INSIDE, 200)) == 1
    # what joins parts and what was not believed shows nothing
    assert twin_odds([*answers(JOINING, 9), *answers(CONTRADICTING, 9, accepted=False)]) == 1


@pytest.mark.parametrize("odds", [1.0, 2.0, 30.0])
def test_odds_count_in_the_weight(odds: float) -> None:
    (answer,) = with_odds(answers(INSIDE, 1), odds)
    wrong = 0.1 * odds / (0.1 * odds + 0.9)
    assert answer.weight == pytest.approx(-np.log(wrong))


def test_among_twins_two_parts_want_more_that_agree() -> None:
    """Two pairs join parts; where eight of ten loops of one part are of twins, it takes four."""
    truth = ring_poses(24)
    gap = chain_of(truth, k15=unsure(0.0))
    rng = np.random.default_rng(6)
    twins: list[RegisteredPair] = []
    for k in range(8):
        off = RigidTransform.from_exp_coords(np.concatenate([0.5 * rng.standard_normal(3), 4 * rng.standard_normal(3)]))
        twins.append(pair(truth, k % 6, 9 + k // 2, "loop", off))
    right = [pair(truth, 0, 7, "loop"), pair(truth, 1, 8, "loop")]
    ties = [pair(truth, 2 + k, 20 - k, "loop") for k in range(4)]
    bridge = pair(truth, 14, 17, "bridge")

    def parts(*more: RegisteredPair) -> int:
        return len(decided(truth, [*gap, *more]).solution.graph.components)

    assert parts(*right, *ties[:2]) == 1
    assert parts(*right, bridge) == 1
    assert parts(*right, *twins, *ties[:2]) == 2
    assert parts(*right, *twins, bridge) == 2
    assert parts(*right, *twins, *ties) == 1
    assert worst(decided(truth, [*gap, *right, *twins, *ties]), truth) < 0.3
