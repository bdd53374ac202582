"""Trajectories: what they refuse, and chains against composition by matrices."""

from itertools import accumulate

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import components, spanning_tree
from sonarmap.slam.graph.trajectory import Trajectory, chain
from tests.samples.surveys import edge, random_transforms

COVARIANCE = np.diag([1.0, 2, 3, 4, 5, 6]) * 1e-4


@pytest.mark.parametrize(
    ("stamps", "T"),
    [
        (np.zeros(1), RigidTransform.identity()),
        (np.zeros(2), RigidTransform.identity(3)),
        (np.zeros(3, np.float32), RigidTransform.identity(3)),
        (np.array([0.0, np.nan, 1.0]), RigidTransform.identity(3)),
        (np.zeros(1), RigidTransform.from_translation([[0.0, np.inf, 0.0]])),
        ([0.0, 1.0], RigidTransform.identity(2)),
        (None, RigidTransform.identity(2)),
        (np.zeros(1), None),
        (np.zeros(1), np.eye(4)[None]),
    ],
)
def test_refuses_what_is_no_trajectory(stamps, T):
    with pytest.raises(InputError):
        Trajectory(stamps, T)


def test_chain_composes_like_matrices_and_take_keeps_stamps_beside_their_poses():
    T = random_transforms(np.random.default_rng(0), 5)
    taken = Trajectory(np.arange(5.0), T).take([3, 1])
    np.testing.assert_array_equal(taken.stamps, [3, 1])
    np.testing.assert_array_equal(taken.T_world_sensor.as_matrix(), T.as_matrix()[[3, 1]])
    rng = np.random.default_rng(1)
    steps = random_transforms(rng, 6)
    edges = [edge(k, k + 1, step, COVARIANCE) for k, step in enumerate(steps)]
    wanted = list(accumulate(steps.as_matrix(), np.matmul, initial=np.eye(4)))
    rng.shuffle(edges)  # pyright: ignore[reportArgumentType]
    np.testing.assert_allclose(chain(edges, np.zeros(7)).T_world_sensor.as_matrix(), wanted, atol=1e-12)


def test_chain_follows_consecutive_edges_and_lets_loops_join_the_rest():
    T = random_transforms(np.random.default_rng(2), 5)
    wrong = random_transforms(np.random.default_rng(3), 1)[0]
    between = {(i, j): T[i].inv() * T[j] for i in range(5) for j in range(5)}
    edges = [
        edge(0, 2, wrong, COVARIANCE, "loop"),  # closes a cycle: the chain has no use for it
        edge(0, 1, between[0, 1], COVARIANCE),
        edge(1, 2, between[1, 2], COVARIANCE),
        edge(4, 3, between[4, 3], COVARIANCE),  # a gap between 2 and 3, an edge told backward
        edge(1, 4, between[1, 4], COVARIANCE, "loop"),
    ]
    chained = chain(edges, np.zeros(5)).T_world_sensor
    np.testing.assert_allclose(chained.as_matrix(), (T[0].inv() * T).as_matrix(), atol=1e-12)
    assert len(spanning_tree(5, edges)) == 4


def test_components_start_at_the_identity_or_at_their_prior():
    T = random_transforms(np.random.default_rng(4), 4)
    edges = [
        edge(0, 1, T[0].inv() * T[1], COVARIANCE),
        edge(2, 3, T[2].inv() * T[3], COVARIANCE),
        edge(3, 3, T[3], COVARIANCE, "prior"),
    ]
    assert components(5, edges) == ((0, 1), (2, 3), (4,))
    poses = chain(edges, np.zeros(5)).T_world_sensor.as_matrix()
    np.testing.assert_allclose(poses[0], np.eye(4), atol=1e-15)
    np.testing.assert_allclose(poses[2:4], T[2:4].as_matrix(), atol=1e-12)
    np.testing.assert_allclose(poses[4], np.eye(4), atol=1e-15)


@pytest.mark.parametrize(
    ("i", "j", "kind", "covariance", "words"),
    [
        *((i, j, kind, COVARIANCE, None) for i, j, kind in ((0, 1, "other"), (-1, 1, "loop"), (2, 2, "loop"))),
        (0, 1, "prior", COVARIANCE, None),
        (0, 1, "sequential", np.diag([1.0, 1, 1, 1, 1, 0]), "positive definite"),
        (0, 1, "sequential", np.diag([1.0, 1, 1, 1, 1, -2]), "positive definite"),
        (0, 1, "sequential", np.eye(6) + np.triu(np.full((6, 6), 1e-3), 1), "not symmetric"),
        (0, 1, "sequential", np.diag([1.0, 1, np.nan, 1, 1, 1]), "not finite"),
        (0, 1, "sequential", np.eye(3), "shape"),
    ],
)
def test_edges_refuse_indices_kinds_and_covariances_that_do_not_fit(i, j, kind, covariance, words):
    with pytest.raises(InputError, match=words):
        edge(i, j, RigidTransform.identity(), covariance, kind)
