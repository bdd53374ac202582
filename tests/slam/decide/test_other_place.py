"""Parts of a map that other pairs place elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.decide.decision import decide
from sonarmap.slam.decide.other_place import OtherPlace, other_places
from sonarmap.slam.pair import RegisteredPair, Role
from sonarmap.spectral.expected import ExpectedPose
from tests.samples.surveys import measurements_of, random_covariance, registration, ring_poses

COVARIANCE = random_covariance(np.random.default_rng(1), 0.002, 0.02)
VOXEL, LOOPS = 0.1, LoopSettings()
TRUTH = ring_poses(12)
# The second half as the step from the fifth to the sixth scan places it, at another place of the same shape.
WRONG = RigidTransform.from_exp_coords([0, 0, 0.6, 4, -1, 0])
FAR = ((0, 7), (1, 8), (2, 9))  # pairs across this step


def pair(i: int, j: int, role: Role, probability: float, off: RigidTransform | None = None) -> RegisteredPair:
    T = TRUTH[i].inv() * (RigidTransform.identity() if off is None else off) * TRUTH[j]
    return RegisteredPair(i, j, role, registration=replace(registration(T, COVARIANCE), probability=probability))


def survey(step: float, *others: RegisteredPair) -> list[RegisteredPair]:
    """Two halves of a ring, joined at a wrong place by a step that is right with this probability."""
    steps = [pair(k, k + 1, "sequential", 0.999) for k in range(11) if k != 5]
    return [*steps, pair(5, 6, "sequential", step, WRONG), *others]


def found(pairs: list[RegisteredPair]) -> tuple[OtherPlace, ...]:
    result = decide(pairs, measurements_of(len(TRUTH)), VOXEL, LOOPS)
    return other_places(result.solution.graph, result.pairs, LOOPS.floor(VOXEL), LOOPS.bound)


def test_more_evidence_against_a_joint_than_for_it_is_told():
    (place,) = found(survey(0.96, *(pair(*scans, "loop", 0.95) for scans in FAR)))
    assert place.scans in (tuple(range(6)), tuple(range(6, 12)))
    assert sorted(place.pairs) == list(FAR)
    assert place.joints == ((5, 6),)


@pytest.mark.parametrize(("probability", "told"), [(0.8, 1), (0.7, 0)])
def test_evidence_is_the_probability_that_all_are_wrong(probability, told):
    """Right with 98 %, the joint has a weight of 3.9; two pairs have 3.2 or 2.4 against it, and 3.0 can join parts."""
    others = (pair(*scans, "loop", probability) for scans in FAR[:2])
    assert len(found(survey(0.98, *others))) == told


def test_pairs_sought_at_an_expected_pose_count_once():
    expected = ExpectedPose.along_target(RigidTransform.identity(), np.ones(6))
    others = [replace(pair(*scans, "loop", 0.9), expected=expected) for scans in FAR]
    assert not found(survey(0.98, *others))
    assert found(survey(0.98, *(replace(each, expected=None) for each in others)))


def test_map_without_contradictions_has_no_other_place():
    right = [pair(k, k + 1, "sequential", 0.999) for k in range(11)]
    assert not found([*right, *(pair(*scans, "loop", 0.95) for scans in FAR)])
    assert not found([*right, *(pair(*scans, "loop", 0.95, WRONG) for scans in FAR[:1])])
