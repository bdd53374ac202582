"""Scan by scan gives what all at once gives."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.optimize.incremental import Incremental, as_they_come
from tests.samples.surveys import chained_graph, edge, measured_edge, random_covariance, ring_poses

COUNT = 25
SIGMAS = 0.02  # most that a pose may lie from the batch optimum, in its deviations


def edges_of(seed: int) -> list[Edge]:
    rng = np.random.default_rng(seed)
    T = ring_poses(COUNT)
    pairs = [(k, k + 1) for k in range(COUNT - 1)] + [(7, 2), (1, 9), (20, 4), (0, COUNT - 1), (COUNT - 2, 1)]
    return [measured_edge(rng, T, i, j, random_covariance(rng)) for i, j in pairs]


def grown(edges: list[Edge], late: int = 0) -> Incremental:
    """Every edge comes with the later of its poses, but for the last `late`, which come in the end."""
    incremental = Incremental()
    early = edges[: len(edges) - late]
    for pose in range(COUNT):
        incremental.add_pose(float(pose), [one for one in early if max(one.i, one.j) == pose])
    incremental.add_edges(edges[len(early) :])
    return incremental


def batch(edges: list[Edge]) -> Solution:
    return chained_graph(edges, COUNT).optimize()


@pytest.mark.parametrize("late", [0, 2])
@pytest.mark.parametrize("seed", [1, 2])
def test_it_is_the_batch_solution(seed: int, late: int) -> None:
    edges = edges_of(seed)
    incremental, solution = grown(edges, late), batch(edges)
    apart = (solution.trajectory.T_world_sensor.inv() * incremental.trajectory.T_world_sensor).as_exp_coords()
    for error, covariance in zip(apart[1:], solution.covariances()[1:], strict=True):
        assert error @ np.linalg.solve(covariance, error) < SIGMAS**2
    for i, j in [(0, 12), (20, 3), (5, 6)]:
        (T, covariance), (T_batch, wanted) = incremental.relative(i, j), solution.relative(i, j)
        scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
        np.testing.assert_allclose(covariance / scale, wanted / scale, atol=0.02)
        error = (T_batch.inv() * T).as_exp_coords()
        assert error @ np.linalg.solve(wanted, error) < SIGMAS**2


def test_a_prior_places_the_first_pose() -> None:
    edges = edges_of(3)
    T = RigidTransform.from_exp_coords([0.2, -0.4, 1.0, 30, -7, 2])
    incremental = Incremental()
    assert incremental.add_pose(5.0, [edge(0, 0, T, np.eye(6) * 1e-4, "prior")]) == 0
    assert incremental.add_pose(6.5, [edges[0]]) == 1
    np.testing.assert_array_equal(incremental.trajectory.stamps, [5.0, 6.5])
    wanted = T * edges[0].registration.T_target_source
    np.testing.assert_allclose(incremental.trajectory.T_world_sensor[1].as_matrix(), wanted.as_matrix(), atol=1e-6)


def test_refuses_poses_that_nothing_ties_and_edges_to_nowhere() -> None:
    edges = edges_of(4)
    incremental = Incremental()
    incremental.add_pose(0.0)
    with pytest.raises(InputError, match="no edge ties pose 1"):
        incremental.add_pose(1.0)
    with pytest.raises(InputError, match="edge 1 -> 2 names a pose"):
        incremental.add_edges([edges[1]])
    assert len(incremental) == 1


def test_a_whole_graph_is_taken_as_it_comes() -> None:
    edges = edges_of(2)
    graph = chained_graph(edges[::-1], COUNT)
    T = as_they_come(graph)
    apart = (batch(edges).trajectory.T_world_sensor.inv() * T).as_exp_coords()
    assert np.abs(apart).max() < 1e-3
    with pytest.raises(InputError, match="no edge ties pose 5"):
        as_they_come(graph.keep(np.array([5 not in (one.i, one.j) or max(one.i, one.j) > 5 for one in graph.edges])))
