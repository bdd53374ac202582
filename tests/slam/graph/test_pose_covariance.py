"""Covariances of poses whose registrations share a scan's error, and marginals against the dense inverse."""

from dataclasses import replace
from itertools import permutations

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.gtsam_poses import to_values
from sonarmap.slam.graph.marginals import marginals
from sonarmap.slam.graph.pose_covariance import joint_covariance, pose_covariances, weighed
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution, factors_of
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.graph.trajectory import Trajectory, chain
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
from tests.samples.lawnmower import lawnmower
from tests.samples.surveys import (
    chain_edges,
    chained_graph,
    drawn,
    edge,
    random_covariance,
    random_transforms,
    ring_poses,
)

COVARIANCE = random_covariance(np.random.default_rng(6), 0.004, 0.03)
COUNT = 30


def ring(seed: int, scale: float = 1.0, world: RigidTransform | None = None) -> tuple[RigidTransform, PoseGraph]:
    """A ring with loops; each scan has an error that all its edges share."""
    rng = np.random.default_rng(seed)
    truth = ring_poses(COUNT)
    shared = drawn(rng, scale**2 * COVARIANCE / 4, COUNT)
    pairs = [(k, k + step) for step in (1, 2, 7) for k in range(COUNT - step)]
    edges = []
    for i, j in pairs:
        own = drawn(rng, 0.4 * scale**2 * COVARIANCE)
        T = (truth[i] * shared[i]).inv() * (truth[j] * shared[j]) * own
        edges.append(edge(i, j, T, COVARIANCE, "sequential" if j == i + 1 else "loop"))
    start = chain(edges, np.zeros(COUNT))
    if world is not None:
        start = type(start)(start.stamps, world * start.T_world_sensor)
    return truth, PoseGraph(start, tuple(edges)).optimize().graph


def solved(graph: PoseGraph) -> tuple[Solution, np.ndarray]:
    """The solution of the graph as the mapper finds it, and the poses' covariances."""
    solution = weighed(graph).optimize()
    return solution, pose_covariances(solution)


def edge_variances(graph: PoseGraph) -> np.ndarray:
    """(E,) factors by which `weighed` multiplies the covariances of edges."""
    pairs = zip(weighed(graph).edges, graph.edges, strict=True)
    return np.array([after.registration.covariance[3, 3] / edge.registration.covariance[3, 3] for after, edge in pairs])


def normalized(truth: RigidTransform, T: RigidTransform, covariances: np.ndarray) -> np.ndarray:
    """Squared Mahalanobis errors of all poses but the first, relative to the first."""
    xi = ((T[0].inv() * T).inv() * (truth[0].inv() * truth)).as_exp_coords()[1:]
    return np.einsum("na,na->n", xi, np.linalg.solve(covariances[1:], xi[..., None])[..., 0])


@pytest.mark.slow
def test_covariances_hold_errors_that_scans_share():
    plain, wide = [], []
    for seed in range(12):
        truth, graph = ring(seed)
        solution, covariances = solved(graph)
        T = solution.trajectory.T_world_sensor
        plain.append(normalized(truth, T, solution.covariances() / 13))
        wide.append(normalized(truth, T, covariances))
    assert (np.concatenate(plain) <= 12.59).mean() < 0.5
    assert (np.concatenate(wide) <= 12.59).mean() >= 0.85
    assert np.concatenate(wide).mean() > 2


def test_an_edge_that_others_contradict_gets_a_larger_covariance():
    """It is off by four standard deviations: too little to be refused, too much to keep its weight."""
    _, graph = ring(3)
    before = edge_variances(graph)
    edges = list(graph.edges)
    leaning = next(k for k, each in enumerate(edges) if (each.i, each.j) == (4, 11))
    lean = RigidTransform.from_exp_coords(4 * np.sqrt(np.diag(COVARIANCE)) * [0, 0, 1, 1, 0, 0])
    registration = edges[leaning].registration
    turned_away = replace(registration, T_target_source=registration.T_target_source * lean)
    edges[leaning] = replace(edges[leaning], registration=turned_away)
    after = edge_variances(replace(graph, edges=tuple(edges)))
    assert after[leaning] > 4 * before[leaning]
    others = np.arange(len(edges)) != leaning
    assert np.median(after[others] / before[others]) == pytest.approx(1.0, abs=0.1)


def test_fixes_keep_their_sigmas():
    """Positions to two centimeters beside registrations to a decimeter."""
    truth, graph = ring(5)
    sigmas = np.array([0.01, 0.01, 0.02, 0.02, 0.02, 0.02])
    measured = tuple((k, PosePrior(truth[k], sigmas)) for k in range(COUNT))
    _, covariances = solved(replace(graph, priors=measured))
    by_position = np.sqrt(np.diagonal(covariances[:, 3:, 3:], axis1=1, axis2=2))
    assert by_position.max() < 0.0205
    lone = PoseGraph(graph.trajectory, (), priors=measured)
    alone = pose_covariances(lone.optimize())
    np.testing.assert_allclose(np.diagonal(alone, axis1=1, axis2=2)[:, 3:], 0.02**2, rtol=0.02)


def test_depths_do_not_shrink_the_covariances_of_rotations():
    truth, graph = ring(5)
    depth = tuple((k, PosePrior(truth[k], np.array([np.inf] * 5 + [0.001]))) for k in range(COUNT))
    _, without = solved(graph)
    solution, with_depth = solved(replace(graph, priors=depth))
    up = np.array([T.rotation.inv().apply([0, 0, 1.0]) for T in solution.trajectory.T_world_sensor])
    variance = np.einsum("na,nab,nb->n", up, with_depth[:, 3:, 3:], up)
    assert variance.max() < 1.1 * 0.001**2
    assert np.trace(with_depth[-1, :3, :3]) > 0.1 * np.trace(without[-1, :3, :3])


def test_covariances_are_positive_definite_and_the_same_in_any_world():
    world = RigidTransform.from_exp_coords([0.4, -0.2, 2.0, 30, -70, 5])
    here, there = (solved(ring(4, world=T)[1])[1] for T in (None, world))
    np.testing.assert_allclose(here[1:], there[1:], rtol=1e-2, atol=1e-8)
    assert (np.linalg.eigvalsh(here[1:]) > 0).all()
    np.testing.assert_allclose(here, here.swapaxes(1, 2), atol=1e-12)


TOLERANCE = 1e-6  # of the largest element; the inversion loses digits, as the gauge is held a million times better


def random_graph(seed: int) -> PoseGraph:
    """1 to 12 poses, most of them joined to an earlier one, and up to twice as many loops."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 13))
    pairs = [(int(rng.integers(0, k)), k) for k in range(1, count) if rng.random() > 0.05]
    for _ in range(int(rng.integers(0, 2 * count)) if count > 1 and seed % 3 else 0):
        i, j = rng.choice(count, 2, replace=False).tolist()
        pairs.append((i, j))
    T = random_transforms(rng, count, angle=0.5)
    return PoseGraph(Trajectory(np.arange(float(count)), T), tuple(measured(rng, T, i, j) for i, j in pairs))


def measured(rng: np.random.Generator, T: RigidTransform, i: int, j: int) -> Edge:
    return edge(i, j, T[i].inv() * T[j], random_covariance(rng), "sequential" if j == i + 1 else "loop")


@pytest.mark.parametrize("seed", range(8))
def test_marginals_are_blocks_of_the_dense_inverse(seed: int) -> None:
    graph = random_graph(seed)
    count = len(graph.trajectory)
    pairs = np.array([*permutations(range(count), 2)], np.intp).reshape(-1, 2)
    linear = factors_of(graph, gauge_sigma=1e-2).linearize(to_values(graph.trajectory.T_world_sensor))
    ordering = gtsam.Ordering()
    for key in range(count):
        ordering.push_back(key)
    full = np.linalg.inv(linear.hessian(ordering)[0]).reshape(count, 6, count, 6).swapaxes(1, 2)
    found, every = marginals(linear, pairs), np.arange(count)
    np.testing.assert_allclose(found.single, full[every, every], atol=TOLERANCE * np.abs(full).max())
    np.testing.assert_allclose(found.across, full[pairs[:, 0], pairs[:, 1]], atol=TOLERANCE * np.abs(full).max())


def test_a_graph_without_a_unique_solution_is_refused() -> None:
    rng = np.random.default_rng(0)
    T = random_transforms(rng, 4)
    graph = PoseGraph(Trajectory(np.arange(4.0), T), (measured(rng, T, 0, 1), measured(rng, T, 2, 3)))
    # without the factor that holds the second component
    factors = factors_of(graph)
    loose = gtsam.NonlinearFactorGraph()
    for k in range(factors.size() - 1):
        loose.add(factors.at(k))
    linear = loose.linearize(to_values(T))
    with pytest.raises(RuntimeError):
        marginals(linear, np.array([[0, 1]]))
    solution = graph.optimize()
    object.__setattr__(solution, "_linear", linear)
    with pytest.raises(InputError, match="no unique solution"):
        solution.covariances()


def test_a_step_that_the_motion_pulled_off_is_doubted_as_a_whole():
    """At a lane's end the vehicle went 4 m less than usual. If the scans alone were doubted, the motion would pull the
    step even farther."""
    _, graph = ring(3)
    edges = list(graph.edges)
    k = next(n for n, each in enumerate(edges) if (each.i, each.j) == (4, 5))
    by_scans = edges[k].registration
    away = np.array([0.0, 0.0, 0.0, 4.0, 0.0, 0.0])
    covariance = np.linalg.inv(np.linalg.inv(by_scans.covariance) + np.eye(6))
    drawn = replace(
        by_scans,
        T_target_source=by_scans.T_target_source * RigidTransform.from_exp_coords(covariance @ away),
        covariance=(covariance + covariance.T) / 2,
        T_by_scans=by_scans.T_target_source,
        covariance_by_scans=by_scans.covariance,
    )
    loose = replace(drawn, T_target_source=drawn.T_target_source * RigidTransform.from_translation([0.1, 0.0, 0.0]))
    edges[k] = replace(edges[k], registration=loose)
    weighed_edge = weighed(replace(graph, edges=tuple(edges))).edges[k].registration
    assert weighed_edge.covariance[3, 3] > 10 * drawn.covariance[3, 3]

    def drawn_by(registration: Registration) -> float:
        return float(np.linalg.norm((by_scans.T_target_source.inv() * registration.T_target_source).translation))

    assert drawn_by(weighed_edge) < 1.0
    assert drawn_by(edges[k].scaled(1000.0).registration) > 3.0


@pytest.mark.slow
def test_chi_squared_scales_covariances_whatever_was_stated():
    """One sonar's registrations are a third as far off as stated: with many loops its poses are more certain."""
    factors = [np.median(edge_variances(ring(3, scale)[1])) for scale in (0.5, 1.0, 2.0)]
    assert factors[0] < factors[1] < factors[2]
    _, graph = ring(3)
    first, second = (np.diagonal(solved(each)[1], axis1=1, axis2=2)[1:] for each in (graph, graph.scaled(10.0)))
    assert (second < 1.5 * first).all()


def test_steps_with_three_unconstrained_directions_are_weighed():
    """They fix no pose well enough for GTSAM's covariances, which edges outside of cycles do not need."""
    rng = np.random.default_rng(2)
    at_bed = np.diag([0.003, 0.003, 2.0, 60.0, 60.0, 0.01]) ** 2
    truth = ring_poses(40)
    edges = []
    for k in range(39):
        to_sensor = RigidTransform.from_components(rng.normal([20, 5, -30], 3.0), Rotation.random(rng=rng))
        edges.append(edge(k, k + 1, truth[k].inv() * truth[k + 1], propagated(to_sensor, at_bed)))
    np.testing.assert_allclose(edge_variances(chained_graph(edges, 40)), 13 * 0.15, rtol=1e-6)


def test_scale_errors_grow_from_where_a_component_is_held():
    """From its first pose if positions are not measured, else from its middle."""
    truth, graph = ring(5)
    open_place = np.array([0.01, 0.01, np.inf, np.inf, np.inf, 0.05])
    everything = np.array([0.01, 0.01, 0.02, 3.0, 3.0, 0.05])
    for sigmas, middle in ((open_place, 0), (everything, None)):
        priors = tuple((k, PosePrior(truth[k], sigmas)) for k in range(COUNT))
        solution, covariances = solved(replace(graph, priors=priors))
        T = solution.trajectory.T_world_sensor
        held = T.translation.mean(axis=0) if middle is None else T.translation[middle]
        away = T.translation - held
        turn = np.asarray(T.rotation.as_matrix())
        added = turn @ (covariances - solution.covariances())[:, 3:, 3:] @ turn.swapaxes(1, 2)
        # horizontal, as depths are measured; positions to 3 m correct little
        squared = (away[:, :2] ** 2).sum(axis=1)
        far = squared > squared.mean() / 2
        shares = np.trace(added[far, :2, :2], axis1=1, axis2=2) / squared[far]
        assert shares.min() > 0
        assert shares.max() < 1.3 * shares.min()


def test_distances_are_exact_or_infinite_beyond_the_limit() -> None:
    rng = np.random.default_rng(1)
    T, graph = lawnmower(120, 1.0, 1)
    pairs = np.array([rng.choice(120, 2, replace=False) for _ in range(40)])
    off = RigidTransform.from_exp_coords(rng.normal(size=(40, 6)) * np.geomspace(1e-3, 10, 40)[:, None])
    tried = [edge(i, j, T[i].inv() * T[j] * own, np.eye(6) * 1e-4, "loop").registration
             for (i, j), own in zip(pairs.tolist(), off, strict=True)]  # fmt: skip
    solution = graph.optimize()
    exact, known = solution.distances(pairs, tried), solution.distances(pairs, tried, most=6.0)
    near = np.isfinite(known)
    np.testing.assert_allclose(known[near], exact[near], rtol=1e-6)
    assert (exact[~near] > 6).all()
    assert (exact <= 6).any()
    assert not near.all()


def test_blocks_of_the_joint_covariance_are_the_marginals_as_left_tangents() -> None:
    rng = np.random.default_rng(3)
    count, T = 6, ring_poses(6)
    covariance = random_covariance(rng, 0.01, 0.1)
    edges = [*chain_edges(T, covariance), edge(0, count - 1, T[0].inv() * T[count - 1], covariance, "loop")]
    solution = chained_graph(edges, count).optimize()
    whole = joint_covariance(solution.graph, range(count))
    joint = whole.reshape(count, 6, count, 6)
    T = solution.trajectory.T_world_sensor
    single = propagated(T, solution.covariances())
    np.testing.assert_allclose([joint[k, :, k] for k in range(count)], single, rtol=1e-4, atol=1e-8)
    i, j = 2, 4
    # the error of T_i_j is the difference of both left tangents, as a body tangent of j
    apart = joint[i, :, i] + joint[j, :, j] - joint[i, :, j] - joint[j, :, i]
    np.testing.assert_allclose(propagated(T[j].inv(), apart), solution.relative(i, j)[1], rtol=1e-4, atol=1e-8)
    some = joint_covariance(solution.graph, [4, 1])
    rows = [*range(24, 30), *range(6, 12)]
    np.testing.assert_allclose(some, whole[np.ix_(rows, rows)], rtol=1e-6, atol=1e-12)
