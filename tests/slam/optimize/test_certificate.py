"""The isotropic cost, its optimum and its certificate."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.optimize.certificate import certify
from sonarmap.slam.optimize.chordal import ChordalProblem, Start, optimize_isotropic
from tests.samples.surveys import edge


def poses(rng: np.random.Generator, count: int) -> RigidTransform:
    return RigidTransform.from_components(rng.normal(0, 10, (count, 3)), Rotation.random(count, rng=rng))


def graph(rng: np.random.Generator, T: RigidTransform, pairs: list[tuple[int, int]], noise: float) -> list[Edge]:
    """Edges between poses, each with its own covariance and an error of `noise` standard deviations."""
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
def test_a_noisy_graph_is_certified_from_any_start_and_no_step_lowers_its_cost(seed: int) -> None:
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


def test_a_wound_ring_stays_in_a_local_optimum_and_is_not_certified() -> None:
    """Rotations that wind once more about the vertical than measured: a local optimum."""
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
def test_the_optimum_moves_with_the_first_pose_whatever_the_order_of_edges(start: Start) -> None:
    rng = np.random.default_rng(6)
    true = poses(rng, 10)
    edges = graph(rng, true, ring(10, (0, 5), (7, 2)), 1.0)
    found = optimize_isotropic(ChordalProblem.of(10, edges), true, start)
    moved = RigidTransform.from_exp_coords([0.3, -1.2, 0.7, 5, -8, 2])
    order = rng.permutation(len(edges))
    other = optimize_isotropic(ChordalProblem.of(10, [edges[k] for k in order]), moved * true, start)
    np.testing.assert_allclose(other.T.as_matrix(), (moved * found.T).as_matrix(), atol=1e-4)
    assert other.cost_after == pytest.approx(found.cost_after, rel=1e-9)
