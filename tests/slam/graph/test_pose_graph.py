"""Trajectories and the pose graph: chains, conventions against Monte Carlo, loops, gauges, and a public benchmark."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import components, spanning_tree
from sonarmap.slam.graph.gtsam_poses import to_pose3
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.tangent import adjoint
from sonarmap.slam.graph.trajectory import Trajectory, chain
from tests.samples.surveys import (
    chain_edges,
    chained_graph,
    drawn,
    edge,
    measured_edge,
    random_covariance,
    random_transforms,
    ring_poses,
)


def ring_graph(count: int, rng: np.random.Generator, loops: bool) -> tuple[RigidTransform, PoseGraph]:
    T = ring_poses(count)
    pairs = [(k, k + 1) for k in range(count - 1)] + ([(0, count - 1), (2, count // 2)] if loops else [])
    return T, chained_graph([measured_edge(rng, T, i, j, random_covariance(rng)) for i, j in pairs], count)


def test_covariance_of_a_chain_agrees_with_monte_carlo():
    """Full, uneven covariances over large turns: any other order, side or direction would show at once."""
    rng = np.random.default_rng(1)
    steps = random_transforms(rng, 3, angle=0.8, length=4.0)
    covariances = [random_covariance(rng, 0.004, 0.03) for _ in range(3)]
    solution = chained_graph([edge(k, k + 1, steps[k], covariances[k]) for k in range(3)], 4).optimize()

    draws = 40_000
    T = RigidTransform.identity(draws)
    for step, covariance in zip(steps, covariances, strict=True):
        T = T * step * drawn(rng, covariance, draws)
    last = solution.trajectory.T_world_sensor[3]
    sampled = np.cov((last.inv() * T).as_exp_coords().T)
    predicted = solution.covariances()[3]
    scale = np.sqrt(np.outer(np.diag(predicted), np.diag(predicted)))
    np.testing.assert_allclose(sampled / scale, predicted / scale, atol=0.03)

    _, relative = solution.relative(0, 3)  # the first pose is held, so this is the same
    np.testing.assert_allclose(relative / scale, predicted / scale, atol=1e-4)


def test_loops_lower_the_error_and_covariances_match_it():
    errors, distances = {True: [], False: []}, []
    for seed in range(12):
        for loops in (True, False):
            T, graph = ring_graph(20, np.random.default_rng(seed), loops)
            solution = graph.optimize()
            difference = (solution.trajectory.T_world_sensor.inv() * T).as_exp_coords()
            errors[loops].append(np.sqrt((difference[:, 3:] ** 2).mean()))
            if loops:
                covariance = solution.covariances()[-1]
                distances.append(difference[-1] @ np.linalg.solve(covariance, difference[-1]))
                assert solution.chi_squared_after < solution.chi_squared_before
                assert solution.degrees_of_freedom == 12
    assert np.median(errors[True]) < 0.8 * np.median(errors[False])
    # The sum of 12 squared distances of six degrees each, within its central 99.8 %
    assert chi2(72).ppf(0.001) < sum(distances) < chi2(72).ppf(0.999)


def test_every_component_has_one_anchor():
    rng = np.random.default_rng(6)
    T, covariance = random_transforms(rng, 6), random_covariance(rng)
    edges = (*chain_edges(T, covariance)[::2], edge(3, 3, T[3], covariance, "prior"))
    graph = PoseGraph(Trajectory(np.zeros(6), T), edges, fixed=(5,))
    assert graph.anchors == (0, 5)
    solution = graph.optimize()
    sigmas = np.sqrt(np.trace(solution.covariances(), axis1=1, axis2=2))
    assert (sigmas[[0, 5]] < 1e-5).all()
    np.testing.assert_allclose(solution.covariances()[3], covariance, rtol=1e-6, atol=1e-12)
    assert solution.degrees_of_freedom == 0
    np.testing.assert_allclose(solution.trajectory.T_world_sensor.as_matrix(), T.as_matrix(), atol=1e-8)


def test_refuses_edges_and_fixed_poses_out_of_range():
    covariance, trajectory = np.eye(6), Trajectory(np.zeros(2), RigidTransform.identity(2))
    with pytest.raises(InputError, match="edge 1 -> 2"):
        PoseGraph(trajectory, (edge(1, 2, RigidTransform.identity(), covariance),))
    with pytest.raises(InputError, match="fixed"):
        PoseGraph(trajectory, (), fixed=(2,))


def test_the_optimum_moves_with_the_first_pose_whatever_the_order_of_edges():
    rng = np.random.default_rng(9)
    _, graph = ring_graph(12, rng, loops=True)
    moved = RigidTransform.from_exp_coords([0.3, -1.2, 0.7, 5, -8, 2])
    order = rng.permutation(len(graph.edges))
    shuffled = PoseGraph(graph.trajectory, tuple(graph.edges[k] for k in order))
    found = graph.optimize().trajectory.T_world_sensor
    other = shuffled.at(moved * graph.trajectory.T_world_sensor).optimize().trajectory.T_world_sensor
    np.testing.assert_allclose(other.as_matrix(), (moved * found).as_matrix(), atol=1e-4)


def test_the_start_from_edges_uses_only_the_held_poses():
    rng = np.random.default_rng(10)
    _, graph = ring_graph(12, rng, loops=True)
    solved = PoseGraph(graph.optimize().trajectory, graph.edges, (5,))
    lost = random_transforms(rng, 12, 1.5, 30.0)
    known = list(solved.anchors)
    T = RigidTransform.from_matrix(
        np.stack([(solved.trajectory.T_world_sensor if k in known else lost)[k].as_matrix() for k in range(12)])
    )
    started = solved.at(T).from_edges()
    np.testing.assert_allclose(started.trajectory.T_world_sensor[known].as_matrix(), T[known].as_matrix(), atol=1e-12)
    again = started.optimize()
    assert again.chi_squared_after == pytest.approx(solved.chi_squared, rel=1e-5)


@pytest.mark.parametrize("open_m", [300.0, 1e5])
def test_an_unconstrained_direction_keeps_its_stated_sigma(open_m):
    """Steps along a bare wall, unconstrained along the sensor's last axis: GTSAM meets the smallest pivot last."""
    truth = random_transforms(np.random.default_rng(8), 6)
    covariance = np.diag([1e-3, 1e-3, 1e-3, 0.01, 0.01, open_m]) ** 2
    solution = chained_graph(chain_edges(truth, covariance), 6).optimize()
    np.testing.assert_allclose(solution.covariances()[1], covariance, rtol=1e-3, atol=1e-6 * open_m)


@pytest.mark.parametrize("count", [1, 10, 100])
def test_unconstrained_directions_add_no_information(count):
    """Odometry says 10 m along a wall; registrations see no motion, and do not constrain it."""
    moved = edge(0, 1, RigidTransform.from_translation([10.0, 0, 0]), np.diag([0.01, 0.01, 0.01, 1, 0.1, 0.1]) ** 2)
    still = edge(0, 1, RigidTransform.identity(), np.diag([0.01, 0.01, 0.01, 400, 0.005, 0.005]) ** 2)
    solution = chained_graph([moved, *[still] * count], 2).optimize()
    weight = count / 400**2
    assert solution.trajectory.T_world_sensor.translation[1, 0] == pytest.approx(10 / (1 + weight), abs=1e-3)
    assert solution.covariances()[1][3, 3] == pytest.approx(1 / (1 + weight), rel=1e-3)


COVARIANCE = np.diag([1.0, 2, 3, 4, 5, 6]) * 1e-4


@pytest.mark.parametrize(
    ("stamps", "T"),
    [
        (np.zeros(2), RigidTransform.identity(3)),
        (np.array([0.0, np.nan, 1.0]), RigidTransform.identity(3)),
        (np.zeros(1), RigidTransform.from_translation([[0.0, np.inf, 0.0]])),
        (None, RigidTransform.identity(2)),
        (np.zeros(1), np.eye(4)[None]),
    ],
)
def test_refuses_invalid_trajectories(stamps, T):
    with pytest.raises(InputError):
        Trajectory(stamps, T)


def test_chain_follows_consecutive_edges_and_lets_loops_join_the_rest():
    T = random_transforms(np.random.default_rng(2), 5)
    wrong = random_transforms(np.random.default_rng(3), 1)[0]
    between = {(i, j): T[i].inv() * T[j] for i in range(5) for j in range(5)}
    edges = [
        edge(0, 2, wrong, COVARIANCE, "loop"),  # closes a cycle, so the chain does not use it
        edge(0, 1, between[0, 1], COVARIANCE),
        edge(1, 2, between[1, 2], COVARIANCE),
        edge(4, 3, between[4, 3], COVARIANCE),  # a gap between 2 and 3, an edge given backward
        edge(1, 4, between[1, 4], COVARIANCE, "loop"),
    ]
    chained = chain(edges, np.zeros(5)).T_world_sensor
    np.testing.assert_allclose(chained.as_matrix(), (T[0].inv() * T).as_matrix(), atol=1e-12)
    assert len(spanning_tree(5, edges)) == 4


@pytest.mark.parametrize(
    ("i", "j", "kind", "covariance", "words"),
    [
        *((i, j, kind, COVARIANCE, None) for i, j, kind in ((0, 1, "other"), (-1, 1, "loop"), (2, 2, "loop"))),
        (0, 1, "sequential", np.diag([1.0, 1, 1, 1, 1, -2]), "positive definite"),
        (0, 1, "sequential", np.eye(6) + np.triu(np.full((6, 6), 1e-3), 1), "not symmetric"),
        (0, 1, "sequential", np.diag([1.0, 1, np.nan, 1, 1, 1]), "not finite"),
    ],
)
def test_edges_refuse_invalid_indices_kinds_and_covariances(i, j, kind, covariance, words):
    with pytest.raises(InputError, match=words):
        edge(i, j, RigidTransform.identity(), covariance, kind)


def test_take_keeps_stamps_beside_their_poses():
    T = random_transforms(np.random.default_rng(0), 5)
    taken = Trajectory(np.arange(5.0), T).take([3, 1])
    np.testing.assert_array_equal(taken.stamps, [3, 1])
    np.testing.assert_array_equal(taken.T_world_sensor.as_matrix(), T.as_matrix()[[3, 1]])


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


@pytest.mark.parametrize("pair", [(1, 2), (2, 1)])
def test_relative_covariance_is_that_of_the_edge_in_either_direction(pair):
    rng = np.random.default_rng(2)
    steps = random_transforms(rng, 3)
    covariance = random_covariance(rng)
    measured = [covariance if k == 1 else random_covariance(rng) for k in range(3)]
    solution = chained_graph([edge(k, k + 1, steps[k], measured[k]) for k in range(3)], 4).optimize()
    T_i_j, relative = solution.relative(*pair)
    if pair == (2, 1):  # T_j_i Exp(xi') with xi' = -Ad(T_i_j) xi
        turned = to_pose3(T_i_j.inv()).AdjointMap()
        covariance = turned @ covariance @ turned.T
        T_i_j = T_i_j.inv()
    np.testing.assert_allclose(T_i_j.as_matrix(), steps[1].as_matrix(), atol=1e-9)
    np.testing.assert_allclose(relative, covariance, atol=1e-6 * np.abs(covariance).max())


def test_residuals_are_mahalanobis_lengths():
    _, graph = ring_graph(8, np.random.default_rng(5), loops=True)
    solution = graph.optimize()
    poses = solution.trajectory.T_world_sensor
    wanted = []
    for e in graph.edges:
        T_i_j = e.registration.T_target_source
        error = (T_i_j.inv() * poses[e.i].inv() * poses[e.j]).as_exp_coords()
        wanted.append(np.sqrt(error @ np.linalg.solve(e.registration.covariance, error)))
    np.testing.assert_allclose(solution.residuals, wanted, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose((solution.residuals**2).sum(), solution.chi_squared_after, rtol=1e-6)


def test_tangents_agree_with_gtsam():
    rng = np.random.default_rng(0)
    T = random_transforms(rng, 1)[0]
    xi = rng.normal(size=6) * 0.7
    np.testing.assert_allclose(to_pose3(T).matrix(), T.as_matrix(), atol=1e-15)
    moved = T * RigidTransform.from_exp_coords(xi)
    np.testing.assert_allclose(to_pose3(T).retract(xi).matrix(), moved.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(to_pose3(T).localCoordinates(to_pose3(moved)), xi, atol=1e-12)
    T = ring_poses(6)
    np.testing.assert_allclose(adjoint(T), np.stack([to_pose3(one).AdjointMap() for one in T]), atol=1e-12)
