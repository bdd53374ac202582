"""What is left of an expected overlap where poses are uncertain, and how many edges lie between two scans."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.candidates.candidates import certainties, displacement, separations
from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.map.cell import outline
from tests.samples.surveys import chain_edges, chained_graph, edge, random_covariance, ring_poses, scans_of

TRUTH, SCANS = ring_poses(6, radius=8.0)[:2], scans_of(ring_poses(6, radius=8.0))[:2]


def pair_with(covariance: np.ndarray) -> Solution:
    """Two scans, the second measured from the first with this covariance."""
    return chained_graph(chain_edges(TRUTH, covariance), 2).optimize()


def forecast(solution: Solution) -> float:
    pair = np.array([[0, 1]])
    return float(certainties([outline(scan, 1.0) for scan in SCANS], pair, *solution.relatives(pair), 1.0)[0])


def test_a_sure_pose_leaves_the_overlap_and_an_unsure_one_takes_from_it():
    covariance = random_covariance(np.random.default_rng(3), 1e-4, 1e-3)
    left = [forecast(pair_with(scale * covariance)) for scale in (1, 1e5, 1e8)]
    assert left[0] > 0.97
    assert 1 > left[1] > left[2] + 0.1


def test_a_displacement_is_the_root_mean_square_over_all_points():
    rng = np.random.default_rng(7)
    outlines = [rng.normal(size=(50, 3)) * [3, 1, 2] + [1, -2, 4] for _ in range(3)]
    pairs = np.array([(0, 2), (2, 1)])
    covariances = np.stack([random_covariance(rng, 0.01, 0.05) for _ in pairs])
    told = displacement(outlines, pairs, covariances)
    for (_, j), covariance, one in zip(pairs, covariances, told, strict=True):
        xi = rng.multivariate_normal(np.zeros(6), covariance, 20_000)
        moved = np.cross(xi[:, None, :3], outlines[j]) + xi[:, None, 3:]
        assert one == pytest.approx(np.sqrt((moved**2).sum(axis=2).mean()), rel=0.02)


T, COVARIANCE = RigidTransform.identity(), np.eye(6)


def test_it_is_the_shortest_way_by_at_most_one_loop() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        loops = [tuple(sorted(rng.choice(40, 2, replace=False).tolist())) for _ in range(6)]
        chain = chain_edges(RigidTransform.identity(40), COVARIANCE)
        edges = [*chain, *(edge(i, j, T, COVARIANCE, "loop") for i, j in loops if j - i > 1)]
        pairs = np.array([rng.choice(40, 2, replace=False) for _ in range(30)])
        wanted = [
            min([abs(i - j), *(1 + min(abs(i - a) + abs(j - b), abs(i - b) + abs(j - a)) for a, b in loops)])
            for i, j in pairs.tolist()
        ]
        np.testing.assert_array_equal(separations(40, edges, pairs), wanted)


CHAIN = chain_edges(RigidTransform.identity(10), COVARIANCE)


def test_a_gap_is_crossed_by_a_loop_alone() -> None:
    chain = [one for one in CHAIN if one.i != 4]
    pairs = np.array([(3, 4), (3, 7), (0, 9)])
    np.testing.assert_array_equal(separations(10, chain, pairs), [1, np.inf, np.inf])
    bridge = edge(4, 6, T, COVARIANCE, "loop")
    np.testing.assert_array_equal(separations(10, [*chain, bridge], pairs), [1, 3, 8])
    np.testing.assert_array_equal(separations(11, CHAIN, np.array([(0, 10), (3, 4)])), [np.inf, 1])


def test_the_forecast_asks_only_for_what_is_between_the_scans():
    """The world may be moved."""
    graph = pair_with(random_covariance(np.random.default_rng(4), 0.05, 0.5)).graph
    moved = RigidTransform.from_exp_coords([0.3, -0.2, 1.1, 40, -7, 3]) * graph.trajectory.T_world_sensor
    here, there = (forecast(each.optimize()) for each in (graph, graph.at(moved)))
    assert here == pytest.approx(there, abs=0.02)
