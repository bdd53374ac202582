"""The isotropic cost, its optimum and certificate; and scan by scan what all at once gives."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.optimize.certificate import certify
from sonarmap.slam.optimize.chordal import ChordalProblem, Start, optimize_isotropic
from sonarmap.slam.optimize.incremental import Incremental, as_they_come
from tests.samples.surveys import chained_graph, edge, measured_edge, random_covariance, ring_poses


def poses(rng: np.random.Generator, count: int) -> RigidTransform:
    return RigidTransform.from_components(rng.normal(0, 10, (count, 3)), Rotation.random(count, rng=rng))


def graph(rng: np.random.Generator, T: RigidTransform, pairs: list[tuple[int, int]], noise: float) -> list[Edge]:
    """Edges between poses, each with a covariance of its own and `noise` of its deviations."""
    edges = []
    for i, j in pairs:
        root = rng.normal(0, 0.05, (6, 6)) + np.diag([0.05, 0.07, 0.06, 0.2, 0.3, 0.4])
        error = RigidTransform.from_exp_coords(noise * root @ rng.normal(size=6))
        edges.append(edge(i, j, T[i].inv() * T[j] * error, root @ root.T))
    return edges


def ring(count: int, *chords: tuple[int, int]) -> list[tuple[int, int]]:
    return [(k, (k + 1) % count) for k in range(count)] + list(chords)


@pytest.mark.parametrize("count", [2, 12])
def test_the_cost_is_the_sum_over_edges_and_the_trace_of_the_matrix(count: int) -> None:
    rng = np.random.default_rng(count)
    edges = graph(rng, poses(rng, count), ring(count)[: count if count > 2 else 1], 1.0)
    T = poses(rng, count)
    want = 0.0
    for one in edges:
        information = np.linalg.inv(one.registration.covariance)
        kappa = 3 / (2 * np.trace(np.linalg.inv(information[:3, :3])))
        tau = 3 / np.trace(np.linalg.inv(information[3:, 3:]))
        measured = one.registration.T_target_source.as_matrix()
        i, j = T[one.i].as_matrix(), T[one.j].as_matrix()
        off = j - i @ measured
        want += kappa * (off[:3, :3] ** 2).sum() + tau * (off[:3, 3] ** 2).sum()
    problem = ChordalProblem.of(count, edges)
    assert problem.cost(T) == pytest.approx(want, rel=1e-12)
    X = problem.stacked(T)
    assert np.trace(X.T @ (problem.matrix @ X)) == pytest.approx(want, rel=1e-10)
    moved = RigidTransform.from_exp_coords([0.3, -1.2, 0.7, 5, -8, 2]) * T
    assert problem.cost(moved) == pytest.approx(problem.cost(T), rel=1e-12)


def test_a_prior_is_refused() -> None:
    with pytest.raises(InputError, match=r"pose 0 has a prior.*`objective=full`"):
        ChordalProblem.of(1, [edge(0, 0, RigidTransform.identity(), np.eye(6), "prior")])


@pytest.mark.parametrize("seed", range(2))
def test_a_noisy_graph_is_certified_from_any_poses_and_no_step_lowers_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    true = poses(rng, 15)
    problem = ChordalProblem.of(15, graph(rng, true, ring(15, (0, 7), (3, 11), (5, 13)), 1.0))
    start = poses(rng, 15)
    found = optimize_isotropic(problem, start)
    np.testing.assert_allclose(found.T[0].as_matrix(), start[0].as_matrix(), atol=1e-6)
    far = certify(problem, start)
    assert far.verdict == "not certified"
    assert "still falls" in far.reason
    certificate = certify(problem, found.T)
    assert certificate.verdict == "certified", certificate.reason
    assert certificate.gap <= 1e-6 * certificate.cost
    assert found.cost_after == pytest.approx(certificate.cost)
    for _ in range(20):
        step = RigidTransform.from_exp_coords(rng.normal(0, 1e-3, (15, 6)))
        assert problem.cost(found.T * step) > found.cost_after * (1 - 1e-9)


def wound(count: int, turns: float) -> RigidTransform:
    """A ring whose rotations wind about the vertical `turns` times more than its edges say."""
    angles = 2 * np.pi * np.arange(count) / count
    places = 10 * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])
    return RigidTransform.from_components(places, Rotation.from_euler("Z", ((1 + turns) * angles)[:, None]))


def test_a_wound_up_ring_rests_and_is_not_certified() -> None:
    """Rotations that wind once more about the vertical than measured: a local optimum (FINDINGS of the study)."""
    true = wound(40, 0)
    edges = [edge(i, j, true[i].inv() * true[j], np.diag([1e-4, 1e-4, 1e-4, 1e4, 1e4, 1e4])) for i, j in ring(40)]
    problem = ChordalProblem.of(40, edges)
    local = optimize_isotropic(problem, wound(40, 1), "given")
    certificate = certify(problem, local.T)
    assert local.converged
    assert local.cost_after > 1
    assert certificate.verdict == "not certified"
    assert "local optimum" in certificate.reason
    assert certificate.lowest < 0
    assert certificate.cost - certificate.gap <= 0
    assert certify(problem, optimize_isotropic(problem, wound(40, 1)).T).verdict == "certified"


@pytest.mark.parametrize("start", ["chordal", "given"])
def test_the_optimum_moves_with_the_first_pose_and_knows_no_order_of_the_edges(start: Start) -> None:
    rng = np.random.default_rng(6)
    true = poses(rng, 10)
    edges = graph(rng, true, ring(10, (0, 5), (7, 2)), 1.0)
    found = optimize_isotropic(ChordalProblem.of(10, edges), true, start)
    moved = RigidTransform.from_exp_coords([0.3, -1.2, 0.7, 5, -8, 2])
    order = rng.permutation(len(edges))
    other = optimize_isotropic(ChordalProblem.of(10, [edges[k] for k in order]), moved * true, start)
    np.testing.assert_allclose(other.T.as_matrix(), (moved * found.T).as_matrix(), atol=1e-4)
    assert other.cost_after == pytest.approx(found.cost_after, rel=1e-9)


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


@pytest.mark.parametrize(("seed", "late"), [(1, 0), (2, 2)])
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


def test_a_whole_graph_is_taken_as_it_comes() -> None:
    edges = edges_of(2)
    graph = chained_graph(edges[::-1], COUNT)
    T = as_they_come(graph)
    apart = (batch(edges).trajectory.T_world_sensor.inv() * T).as_exp_coords()
    assert np.abs(apart).max() < 1e-3
    with pytest.raises(InputError, match="no edge ties pose 5"):
        as_they_come(graph.keep(np.array([5 not in (one.i, one.j) or max(one.i, one.j) > 5 for one in graph.edges])))


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
