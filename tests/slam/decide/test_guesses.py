"""Steps that only the usual motion tells: a guess joins parts, and never outweighs a registration."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.decide.decision import Decision, decide
from sonarmap.slam.pair import RegisteredPair
from tests.samples.surveys import measurements_of, registration, ring_poses

COUNT, GAP = 12, 5
TRUTH = ring_poses(COUNT)
COVARIANCE, WIDE = np.diag([1e-5] * 3 + [1e-3] * 3), np.diag([1e-3] * 3 + [1.0] * 3)


def pair(i: int, j: int, **changes: object) -> RegisteredPair:
    said = replace(registration(TRUTH[i].inv() * TRUTH[j], COVARIANCE), probability=0.997, reason="as it is")
    return RegisteredPair(i, j, "sequential" if j == i + 1 else "loop", registration=replace(said, **changes))


def guessed(k: int, off: float) -> RegisteredPair:
    """A refused step, which was found far away, with a guess that is off by so much [m]."""
    T = TRUTH[k].inv() * TRUTH[k + 1] * RigidTransform.from_translation([off, 0.0, 0.0])
    refused = {"accepted": False, "probability": 0.3}
    guess = replace(registration(T, WIDE), reason="assumed", **refused)
    away = RigidTransform.from_translation([0.0, 40.0, 5.0])
    return replace(pair(k, k + 1, T_target_source=away, **refused), guess=guess)


def decided(*others: RegisteredPair, gaps: tuple[int, ...] = (GAP,), off: float = 0.5) -> Decision:
    steps = [guessed(k, off) if k in gaps else pair(k, k + 1) for k in range(COUNT - 1)]
    return decide([*steps, *others], measurements_of(COUNT), 0.1, LoopSettings())


def step_of(result: Decision, k: int = GAP):
    (step,) = (pair for pair in result.pairs if pair.scans == (k, k + 1))
    return step


def test_it_joins_what_nothing_else_does_and_is_as_wide_as_it_says() -> None:
    result = decided()
    step = step_of(result)
    assert len(result.solution.graph.components) == 1
    assert (step.kept, step.accepted, step.reason) == (True, False, "kept: assumed")
    assert step.edge is not None
    # however well the registrations agree
    np.testing.assert_allclose(step.edge.registration.covariance, WIDE)
    assert step.edge.registration.probability == 0.3


@pytest.mark.parametrize("off", [0.5, 9.0])
def test_registrations_that_agree_take_its_place(off: float) -> None:
    result = decided(pair(4, 8), pair(3, 9), off=off)
    assert len(result.solution.graph.components) == 1
    assert [pair.kept for pair in result.pairs[-2:]] == [True, True]
    assert not step_of(result).kept
    T = result.solution.trajectory.T_world_sensor
    np.testing.assert_allclose((T[0].inv() * T).as_matrix(), (TRUTH[0].inv() * TRUTH).as_matrix(), atol=0.05)


@pytest.mark.parametrize(("off", "parts"), [(0.5, 1), (9.0, 2)])
def test_one_accepted_pair_that_contradicts_it_is_enough(off: float, parts: int) -> None:
    result = decided(pair(3, 9), off=off)
    assert len(result.solution.graph.components) == parts
    assert result.pairs[-1].kept == (parts == 1)


@pytest.mark.parametrize(("off", "parts"), [(0.5, 1), (9.0, 2)])
def test_none_counts_where_the_others_prove_wrong(off: float, parts: int) -> None:
    """As of scans in no order: what pairs know of one step is far from what the motion has there."""
    result = decided(pair(0, 2), pair(0, 3), pair(1, 4), gaps=(2, 8), off=off)
    assert len(result.solution.graph.components) == parts
    assert step_of(result, 8).kept == (parts == 1)
