"""How sure poses are said to be, when registrations of one scan share its error."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from slam.graph.pose_covariance import pose_covariances, variance_factor
from slam.graph.pose_graph import PoseGraph, Solution
from slam.graph.tangent import carried
from slam.graph.trajectory import chain
from tests.samples.surveys import edge, random_covariance, ring_poses

COVARIANCE = random_covariance(np.random.default_rng(6), 0.004, 0.03)
COUNT = 30


def solved(seed: int, scale: float = 1.0, world: RigidTransform | None = None) -> tuple[RigidTransform, Solution]:
    """A ring with loops, each scan with an error of its own that all its edges share."""
    rng = np.random.default_rng(seed)
    truth = ring_poses(COUNT)
    shared = RigidTransform.from_exp_coords(scale * rng.multivariate_normal(np.zeros(6), COVARIANCE / 2, COUNT))
    apart = scale * np.sqrt(0.4)  # what an edge has of its own
    pairs = [(k, k + step) for step in (1, 2, 7) for k in range(COUNT - step)]
    edges = []
    for i, j in pairs:
        own = RigidTransform.from_exp_coords(apart * rng.multivariate_normal(np.zeros(6), COVARIANCE))
        T = (truth[i] * shared[i]).inv() * (truth[j] * shared[j]) * own
        edges.append(edge(i, j, T, COVARIANCE, "sequential" if j == i + 1 else "loop"))
    start = chain(edges, np.zeros(COUNT))
    if world is not None:
        start = type(start)(start.stamps, world * start.T_world_sensor)
    return truth, PoseGraph(start, tuple(edges)).optimize()


def normalized(truth: RigidTransform, T: RigidTransform, covariances: np.ndarray) -> np.ndarray:
    """Squared errors of all poses but the first, against the first."""
    xi = ((T[0].inv() * T).inv() * (truth[0].inv() * truth)).as_exp_coords()[1:]
    return np.einsum("na,na->n", xi, np.linalg.solve(covariances[1:], xi[..., None])[..., 0])


def test_errors_that_scans_share_are_within_what_is_told_and_not_within_the_marginals():
    plain, told = [], []
    for seed in range(12):
        truth, solution = solved(seed)
        T = solution.trajectory.T_world_sensor
        plain.append(normalized(truth, T, solution.covariances()))
        told.append(normalized(truth, T, pose_covariances(solution)))
    assert (np.concatenate(plain) <= 12.59).mean() < 0.8
    assert (np.concatenate(told) <= 12.59).mean() >= 0.9
    assert np.concatenate(told).mean() > 2


def test_larger_errors_are_told_by_chi_squared():
    factors = [variance_factor(solved(3, scale)[1]) for scale in (0.5, 1.0, 2.0)]
    assert factors[0] < factors[1] < factors[2]


def test_a_graph_without_loops_is_given_what_is_expected():
    truth = ring_poses(5)
    edges = tuple(edge(k, k + 1, truth[k].inv() * truth[k + 1], COVARIANCE) for k in range(4))
    solution = PoseGraph(chain(edges, np.zeros(5)), edges).optimize()
    factor = variance_factor(solution)
    assert factor == pytest.approx(5 * 0.45)
    covariances = pose_covariances(solution)
    # the anchor is where it is; the next scan has its own part and the anchor's besides the one edge
    np.testing.assert_allclose(covariances[0], factor * solution.covariances()[0], atol=1e-12)
    T_0_1, T_1_2 = truth[0].inv() * truth[1], truth[1].inv() * truth[2]
    own = 0.6 * factor * (COVARIANCE + turned(T_1_2, COVARIANCE)) / 2
    anchors = carried(T_0_1.inv(), 0.6 * factor * turned(T_0_1, COVARIANCE))
    np.testing.assert_allclose(covariances[1], factor * COVARIANCE + own + anchors, rtol=2e-3, atol=1e-9)


def turned(T: RigidTransform, covariance: np.ndarray) -> np.ndarray:
    """In other axes, about the same point."""
    turn = np.kron(np.eye(2), T.rotation.as_matrix())
    return turn @ covariance @ turn.T


def test_they_are_positive_definite_and_do_not_depend_on_where_the_world_is():
    world = RigidTransform.from_exp_coords([0.4, -0.2, 2.0, 30, -70, 5])
    here, there = (pose_covariances(solved(4, world=T)[1]) for T in (None, world))
    np.testing.assert_allclose(here[1:], there[1:], rtol=1e-2, atol=1e-8)
    assert (np.linalg.eigvalsh(here[1:]) > 0).all()
    np.testing.assert_allclose(here, here.swapaxes(1, 2), atol=1e-12)
