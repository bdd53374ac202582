"""Dead reckoning: what it expects, what it contradicts, and what it is worth in a graph."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.motion.measured_motion import MeasuredMotion
from sonarmap.slam.motion.odometry import Odometry
from tests.samples.surveys import chained_graph, ring_poses
from tests.slam.motion.test_motion import learned, steps

POSES = ring_poses(30)
WORLD = RigidTransform.from_exp_coords([0.2, -0.1, 2.0, 40.0, -30.0, 5.0])
FLOOR = np.repeat([0.01, 0.05], 3)
TIMES = 100.0 + 2.0 * np.arange(30)
ODOMETRY = Odometry(np.arange(30), WORLD * POSES, TIMES, drift=0.02, turn_drift=0.001)


def test_it_expects_what_it_measured_with_an_error_that_grows_with_the_way_and_the_time() -> None:
    expected, T = ODOMETRY.expected(3, 9, FLOOR), POSES[3].inv() * POSES[9]
    np.testing.assert_allclose(expected.T_target_source.as_matrix(), T.as_matrix(), atol=1e-5)
    way = np.linalg.norm(np.diff(POSES.translation[3:10], axis=0), axis=1).sum()
    turn = 0.001 * 12.0
    sigmas = expected.sigmas
    np.testing.assert_allclose(sigmas[:3], np.hypot(turn, 0.01), rtol=1e-4)
    np.testing.assert_allclose(sigmas[3:], np.hypot(0.02 * way + turn * way / 2, 0.05), rtol=1e-4)
    # it contradicts what is far off alone
    assert not ODOMETRY.contradicts(3, 9, T * RigidTransform.from_translation([0.4, 0.3, 0.0]), FLOOR)
    assert ODOMETRY.contradicts(3, 9, T * RigidTransform.from_translation([4.0, 3.0, 0.0]), FLOOR)
    assert ODOMETRY.contradicts(3, 9, T * RigidTransform.from_exp_coords([0, 0, 0.5, 0, 0, 0]), FLOOR)


def test_all_its_edges_together_err_as_much_as_the_whole() -> None:
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


def test_where_it_tells_nothing_anything_is_expected() -> None:
    motion = MeasuredMotion(Odometry(np.arange(10), POSES[:10], TIMES[:10]), None, FLOOR)
    assert motion.is_measured(3, 4)
    assert not motion.is_measured(3, 14)
    assert motion.expected(3, 14).sigmas.min() > 3
    assert not motion.contradicts(3, 14, RigidTransform.from_translation([500.0, 0, 0]))
    assert motion.is_beyond(3, 4, RigidTransform.from_translation([500.0, 0, 0]))


def test_where_it_tells_nothing_the_learned_motion_does() -> None:
    pairs = steps(20)
    learned_motion = learned(pairs)
    motion = MeasuredMotion(Odometry(np.arange(10), POSES[:10], TIMES[:10]), learned_motion, FLOOR)
    assert motion.way(3, 4) is None
    assert motion.way(14, 15) == learned_motion.way(14, 15)
    fewer = motion.following(pairs[:15]).expected(16, 17)
    np.testing.assert_array_equal(fewer.sigmas, learned_motion.following(pairs[:15]).expected(16, 17).sigmas)
    assert (fewer.sigmas >= motion.expected(16, 17).sigmas).all()
    unlearned = MeasuredMotion(motion.odometry, None, FLOOR)
    assert unlearned.way(14, 15) is None
    assert unlearned.following(pairs) is unlearned


def test_bad_odometry_is_refused() -> None:
    for count, drift, words in ((4, 0.1, "a scan, a pose and a time each"), (5, -0.1, "0 or more")):
        with pytest.raises(InputError, match=words):
            Odometry(np.arange(count), POSES[:5], TIMES[:5], drift=drift)
