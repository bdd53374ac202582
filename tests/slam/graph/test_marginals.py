"""Marginals against the dense inverse and GTSAM's, on graphs of all shapes."""

import time

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.gtsam_poses import to_values
from sonarmap.slam.graph.marginals import Marginals, marginals
from sonarmap.slam.graph.pose_graph import PoseGraph, factors_of
from sonarmap.slam.graph.trajectory import Trajectory
from tests.samples.lawnmower import lawnmower
from tests.samples.surveys import edge, random_covariance, random_transforms

TOLERANCE = 1e-6  # of the largest element, which the inversion of a gauge held a million times better leaves


def random_graph(seed: int) -> PoseGraph:
    """1 to 40 poses, each joined to an earlier one or, seldom, to none; and up to twice as many loops."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 41))
    pairs = [(int(rng.integers(0, k)), k) for k in range(1, count) if rng.random() > 0.05]
    for _ in range(int(rng.integers(0, 2 * count)) if count > 1 and seed % 3 else 0):
        i, j = rng.choice(count, 2, replace=False).tolist()
        pairs.append((i, j))
    T = random_transforms(rng, count, angle=0.5)
    return PoseGraph(Trajectory(np.arange(float(count)), T), tuple(measured(rng, T, i, j) for i, j in pairs))


def measured(rng: np.random.Generator, T: RigidTransform, i: int, j: int) -> Edge:
    return edge(i, j, T[i].inv() * T[j], random_covariance(rng), "sequential" if j == i + 1 else "loop")


def asked(graph: PoseGraph, rng: np.random.Generator) -> np.ndarray:
    """Pairs anywhere, in both orders, twice, and of edges."""
    count = len(graph.trajectory)
    if count == 1:
        return np.empty((0, 2), np.intp)
    drawn = np.array([rng.choice(count, 2, replace=False) for _ in range(8)])
    edges = np.array([(one.i, one.j) for one in graph.edges[:3]], np.intp).reshape(-1, 2)
    return np.concatenate([drawn, drawn[:3, ::-1], drawn[:2], edges])


def close(found: Marginals, pairs: np.ndarray, full: np.ndarray) -> None:
    """Against the (N, N, 6, 6) blocks of the whole covariance."""
    largest = np.abs(full).max()
    every = np.arange(len(full))
    np.testing.assert_allclose(found.single, full[every, every], atol=TOLERANCE * largest)
    np.testing.assert_allclose(found.across, full[pairs[:, 0], pairs[:, 1]], atol=TOLERANCE * largest)


@pytest.mark.parametrize("seed", range(30))
def test_they_are_blocks_of_the_dense_inverse(seed: int) -> None:
    graph = random_graph(seed)
    pairs, count = asked(graph, np.random.default_rng(seed)), len(graph.trajectory)
    linear = factors_of(graph, gauge_sigma=1e-2).linearize(to_values(graph.trajectory.T_world_sensor))
    ordering = gtsam.Ordering()
    for key in range(count):
        ordering.push_back(key)
    full = np.linalg.inv(linear.hessian(ordering)[0])
    close(marginals(linear, pairs), pairs, full.reshape(count, 6, count, 6).swapaxes(1, 2))


@pytest.mark.parametrize("seed", range(4))
def test_they_are_those_of_gtsam(seed: int) -> None:
    graph = random_graph(seed)
    pairs, values = asked(graph, np.random.default_rng(seed)), to_values(graph.trajectory.T_world_sensor)
    factors = factors_of(graph, gauge_sigma=1e-2)
    found, known = marginals(factors.linearize(values), pairs), gtsam.Marginals(factors, values)
    single = np.stack([known.marginalCovariance(key) for key in range(len(graph.trajectory))])
    np.testing.assert_allclose(found.single, single, atol=TOLERANCE * np.abs(single).max())
    for (i, j), across in zip(pairs.tolist(), found.across, strict=True):
        joint = known.jointMarginalCovariance([i, j]).at(i, j)
        np.testing.assert_allclose(across, joint, atol=TOLERANCE * np.abs(single).max())


def test_a_graph_that_does_not_tell_every_pose_is_refused() -> None:
    rng = np.random.default_rng(0)
    T = random_transforms(rng, 4)
    graph = PoseGraph(Trajectory(np.arange(4.0), T), (measured(rng, T, 0, 1), measured(rng, T, 2, 3)))
    factors = factors_of(graph)
    # without what holds the second part
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


def test_what_is_surely_beyond_the_most_is_told_so_and_the_rest_exactly() -> None:
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


@pytest.mark.slow
def test_ten_thousand_poses_take_less_than_ten_seconds() -> None:
    T, graph = lawnmower(10_000, 2.0)
    linear = factors_of(graph).linearize(to_values(T))
    begun = time.process_time()
    single = marginals(linear, np.empty((0, 2), np.intp)).single
    assert time.process_time() - begun < 10
    assert np.linalg.eigvalsh(single).min() > 0
