"""Steps that no other pair confirms: gaps where they are few and not sure, unless a person says otherwise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.decide.decision import Decision, decide
from sonarmap.slam.decide.weak_steps import unconfirmed_steps, weak_steps, without_weak_steps
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.pair import RegisteredPair
from sonarmap.slam.tie import Tie
from sonarmap.spectral.expected import ExpectedPose
from tests.samples.surveys import measurements_of, registration, ring_poses

COUNT = 10
TRUTH = ring_poses(COUNT)
COVARIANCE = np.diag([1e-4] * 3 + [1e-2] * 3)
EXPECTED = ExpectedPose.of(RigidTransform.identity(), np.eye(6))


def pair(i: int, j: int, probability: float, accepted: bool = True, expected: bool = False) -> RegisteredPair:
    said = registration(TRUTH[i].inv() * TRUTH[j], COVARIANCE)
    said = replace(said, probability=probability, accepted=accepted, reason="as it is")
    role = "sequential" if j == i + 1 else "loop"
    return RegisteredPair(i, j, role, expected=EXPECTED if expected else None, registration=said)


def survey(
    *unsure: int, probability: float = 0.9, confirmed: tuple[tuple[int, int], ...] = (), farthest: int = 3
) -> list[RegisteredPair]:
    """Steps of which some are unsure, and loops: those across one of these are found where expected, not accepted."""
    steps = [pair(k, k + 1, probability if k in unsure else 0.99) for k in range(COUNT - 1)]
    loops = [(i, j) for i in range(COUNT) for j in range(i + 2, min(i + farthest + 1, COUNT))]

    def across(i: int, j: int) -> bool:
        return any(i <= k < j for k in unsure) and (i, j) not in confirmed

    return [*steps, *(pair(i, j, 0.9, accepted=not across(i, j), expected=across(i, j)) for i, j in loops)]


def decided(pairs: list[RegisteredPair], *ties: Tie) -> Decision:
    measurements = replace(measurements_of(COUNT), ties={tie.scans: tie for tie in ties})
    return decide(pairs, measurements, 0.1, LoopSettings())


def test_weak_step_is_a_gap_that_pairs_about_the_estimate_do_not_bridge() -> None:
    """Though all of that agrees."""
    pairs = survey(4)
    result = decided(pairs)
    assert result.solution.graph.components == (tuple(range(5)), tuple(range(5, COUNT)))
    for got in result.pairs:
        assert got.kept == (not got.i <= 4 < got.j)
    (step,) = (p for p in result.pairs if p.scans == (4, 5))
    assert "right with a probability of 90.0%, and the pairs beside it are refused; as it is" in step.reason


def test_weak_step_stays_if_dead_reckoning_joins_its_scans() -> None:
    """Then what was expected did not come from the step."""
    odometry = Odometry(np.arange(COUNT), TRUTH, np.arange(float(COUNT)))
    measurements = replace(measurements_of(COUNT), odometry=odometry)
    assert decide(survey(4), measurements, 0.1, LoopSettings()).pairs[4].kept


def test_weak_step_stays_if_a_third_of_all_are_weak_or_a_person_accepts_it() -> None:
    many = survey(1, 3, 5, 7)
    assert len(weak_steps(many)) == 4
    assert without_weak_steps(many, ()) is many
    assert len(decided(many).solution.graph.components) == 1
    assert len(decided(survey(1, 4, 7)).solution.graph.components) == 4
    assert len(decided(survey(4), Tie(4, 5, "accept")).solution.graph.components) == 1


@pytest.mark.parametrize(
    ("pairs", "lone"),
    [
        (survey(4), {(4, 5)}),
        (survey(4, 6), {(4, 5), (6, 7)}),
        (survey(4, confirmed=((3, 5),)), set()),
        (survey(4, confirmed=((1, 6),), farthest=5), set()),  # registered freely
        (survey(4, confirmed=((1, 4), (5, 8))), {(4, 5)}),  # on one side of it each
        (survey(4, probability=0.96), set()),
        (survey(4, farthest=1), set()),  # nothing beside it was tried
        (survey(0, 8), set()),  # a dive of one scan is none
        ([p for p in survey(4) if p.scans != (4, 6)], set()),
        ([replace(p, registration=None) if p.expected else p for p in survey(4)], set()),
        ([pair(4, 5, 0.9, accepted=False) if p.scans == (4, 5) else p for p in survey(4)], set()),
        ([], set()),
    ],
)
def test_step_is_weak_if_the_pairs_beside_it_are_refused_and_none_across_confirms_it(
    pairs: list[RegisteredPair], lone: set[tuple[int, int]]
) -> None:
    assert weak_steps(pairs) == lone


@pytest.mark.parametrize("expected", [False, True])
def test_pair_about_the_estimate_confirms_a_step_only_beside_it(expected: bool) -> None:
    """It relies on the step; a loop that was registered freely does not."""
    over_all = [*survey(4), pair(0, COUNT - 1, 0.9, expected=expected)]
    assert weak_steps(over_all) == ({(4, 5)} if expected else set())
    beside = [pair(3, 5, 0.97, expected=expected) if p.scans == (3, 5) else p for p in survey(4)]
    assert weak_steps(beside) == set()
    found = [(step.pair.scans, step.refused) for step in unconfirmed_steps(beside)]
    assert found == ([((4, 5), 1)] if expected else [])
