"""Pairs judged against the truth: right, wrong, kept, rejected, and what is none of these."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.files.map_folder.pairs import TriedPair
from sonarmap.tools.lab.evaluate.pairs import PairScore, score_pairs
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS

VOXEL = 0.7
TRUTH = {
    0: RigidTransform.from_components((3.0, -1.0, 0.5), Rotation.from_euler("ZYX", (0.4, 0.1, -0.2))),
    2: RigidTransform.from_components((-4.0, 6.0, 1.5), Rotation.from_euler("ZYX", (2.1, -0.3, 0.2))),
    5: RigidTransform.from_components((9.0, 2.0, -0.5), Rotation.from_euler("ZYX", (-1.1, 0.2, 0.3))),
}


def tried(i: int, j: int, kept: bool, turn_deg: float = 0.0, shift_voxels: float = 0.0) -> TriedPair:
    """A pair whose measurement is so far from the truth."""
    off = RigidTransform.from_components(
        (0, shift_voxels * VOXEL, 0), Rotation.from_rotvec((0, np.deg2rad(turn_deg), 0))
    )
    return TriedPair(i, j, "loop", kept, TRUTH[i].inv() * TRUTH[j] * off)


def test_right_is_within_both_bounds() -> None:
    pairs = [
        tried(0, 2, True, RIGHT_DEG - 0.01, RIGHT_VOXELS - 0.01),
        tried(0, 2, True, RIGHT_DEG + 0.01),
        tried(2, 5, True, 0.0, RIGHT_VOXELS + 0.01),
        tried(5, 0, False, 1.0, 1.0),
        tried(5, 2, False, 90.0),
        tried(0, 5, False, 0.0, 40.0),
        tried(2, 0, False, 0.0, 4.0),
    ]
    score = score_pairs(pairs, TRUTH, VOXEL)
    assert score == PairScore(kept_right=1, kept_wrong=2, rejected_right=1, rejected_wrong=3)
    assert (score.precision, score.recall) == (1 / 3, 1 / 2)
    assert (score.rejected_precision, score.rejected_recall) == (3 / 4, 3 / 5)


def test_a_larger_voxel_forgives_more() -> None:
    pair = tried(0, 2, True, 0.0, RIGHT_VOXELS + 1)
    assert score_pairs([pair], TRUTH, VOXEL).kept_wrong == 1
    assert score_pairs([pair], TRUTH, 2 * VOXEL).kept_right == 1


def test_a_pair_turned_round_is_as_right() -> None:
    for right in (True, False):
        pair = tried(0, 2, True, 0.0 if right else 30.0)
        assert pair.T_target_source is not None
        back = TriedPair(2, 0, "loop", True, pair.T_target_source.inv())
        assert score_pairs([pair], TRUTH, VOXEL) == score_pairs([back], TRUTH, VOXEL)


def test_failed_and_unjudged_pairs_count_as_neither() -> None:
    identity = RigidTransform.identity()
    pairs = [TriedPair(0, 2, "loop", False, None), TriedPair(0, 1, "loop", True, identity), tried(0, 5, True)]
    score = score_pairs(pairs, TRUTH, VOXEL)
    assert (score.failed, score.unjudged, score.kept_right) == (1, 1, 1)
    assert (score.precision, score.recall) == (1.0, 1.0)


@pytest.mark.parametrize("pairs", [[], [TriedPair(0, 2, "loop", False, None)]])
def test_shares_of_nothing_are_none(pairs: list[TriedPair]) -> None:
    told = score_pairs(pairs, TRUTH, VOXEL).to_json()
    assert [told[name] for name in ("precision", "recall", "rejected_precision", "rejected_recall")] == [None] * 4
