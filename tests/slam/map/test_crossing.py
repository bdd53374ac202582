"""How far overlapping passes lie apart, where it is known."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.map.crossing import APART, PER_SCAN, CrossingError, crossing_error
from sonarmap.slam.map.placed import PlacedScans
from tests.samples.room_scans import look, room_poses

COUNT, VOXEL = 14, 0.3


@pytest.fixture(scope="module")
def scans() -> list:
    rng = np.random.default_rng(1)
    return [look(T, rng) for T in poses()]


def poses() -> RigidTransform:
    """Two passes over the same places."""
    T = room_poses(COUNT)
    return RigidTransform.concatenate([T[:7], T[:7]])


def test_a_shifted_pass_is_told_and_a_true_one_is_not(scans) -> None:
    """All walls are met: a shift along a diagonal of 0.4 m each way is 0.4 m across every one of them."""
    truth = poses()
    shift = RigidTransform.from_translation([0.4, 0.4, 0.4])
    drifted = RigidTransform.concatenate([truth[:7], shift * truth[7:]])
    surveys = [0] * 7 + [1] * 7
    found = crossing_error(PlacedScans.of(scans, truth, VOXEL, surveys=surveys), drifted)
    assert found.before is not None
    assert found.after is not None
    assert found.after.median < 0.02  # ranges err by 0.02 m, and means of a voxel less
    np.testing.assert_allclose(found.before.median, 0.4, atol=0.03)
    assert found.before.most >= found.before.median
    assert all(surveys[one.i] != surveys[one.j] for one in found.crossings)
    turned = crossing_error(PlacedScans.of(scans, shift * truth, VOXEL, surveys=surveys), shift * drifted)
    np.testing.assert_allclose(turned.before.median, found.before.median, atol=0.01)  # pyright: ignore[reportOptionalMemberAccess]


def test_only_scans_far_apart_cross_and_each_a_few_times(scans) -> None:
    names = [2 * k for k in range(COUNT)]
    found = crossing_error(PlacedScans.of(scans, poses(), VOXEL, names), poses())
    assert found.crossings
    taken = [end for one in found.crossings for end in (one.i, one.j)]
    assert max(taken.count(end) for end in taken) <= PER_SCAN
    assert all(one.i in names and one.j - one.i >= APART for one in found.crossings)
    assert all(one.before == one.after for one in found.crossings)
    assert CrossingError.of([found, found]).crossings == found.crossings * 2  # components are counted together


def test_a_single_pass_crosses_nothing_and_another_number_of_poses_is_refused(scans) -> None:
    found = crossing_error(PlacedScans.of(scans[:7], poses()[:7], VOXEL), poses()[:7])
    assert found == CrossingError(())
    assert (found.before, found.after) == (None, None)
    assert crossing_error(PlacedScans.of(scans[:1], poses()[:1], VOXEL), poses()[:1]) == CrossingError(())
    with pytest.raises(InputError, match="14 scans and 13 poses"):
        crossing_error(PlacedScans.of(scans, poses(), VOXEL), poses()[:13])
