"""Expected overlap of scans with uncertain poses, and the number of edges between two scans."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.candidates.candidates import certainties, displacement, separations
from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.map.cell import outline
from tests.samples.surveys import chain_edges, chained_graph, edge, random_covariance, ring_poses, scans_of

TRUTH, SCANS = ring_poses(6, radius=8.0)[:2], scans_of(ring_poses(6, radius=8.0))[:2]


def pair_with(covariance: np.ndarray) -> Solution:
    """Two scans with an edge of this covariance."""
    return chained_graph(chain_edges(TRUTH, covariance), 2).optimize()


def expected_overlap(solution: Solution) -> float:
    pair = np.array([[0, 1]])
    return float(certainties([outline(scan, 1.0) for scan in SCANS], pair, *solution.relatives(pair), 1.0)[0])


def test_uncertain_poses_lower_the_expected_overlap():
    covariance = random_covariance(np.random.default_rng(3), 1e-4, 1e-3)
    overlaps = [expected_overlap(pair_with(scale * covariance)) for scale in (1, 1e5, 1e8)]
    assert overlaps[0] > 0.97
    assert 1 > overlaps[1] > overlaps[2] + 0.1


def test_a_displacement_is_the_root_mean_square_over_all_points():
    rng = np.random.default_rng(7)
    outlines = [rng.normal(size=(50, 3)) * [3, 1, 2] + [1, -2, 4] for _ in range(3)]
    pairs = np.array([(0, 2), (2, 1)])
    covariances = np.stack([random_covariance(rng, 0.01, 0.05) for _ in pairs])
    distances = displacement(outlines, pairs, covariances)
    for (_, j), covariance, distance in zip(pairs, covariances, distances, strict=True):
        xi = rng.multivariate_normal(np.zeros(6), covariance, 20_000)
        moved = np.cross(xi[:, None, :3], outlines[j]) + xi[:, None, 3:]
        assert distance == pytest.approx(np.sqrt((moved**2).sum(axis=2).mean()), rel=0.02)


T, COVARIANCE = RigidTransform.identity(), np.eye(6)


def test_separation_is_the_shortest_path() -> None:
    chain = [each for each in chain_edges(RigidTransform.identity(10), COVARIANCE) if each.i != 4]
    pairs = np.array([(3, 4), (3, 7), (0, 9)])
    np.testing.assert_array_equal(separations(10, chain, pairs), [1, np.inf, np.inf])
    bridge = edge(4, 6, T, COVARIANCE, "loop")
    np.testing.assert_array_equal(separations(10, [*chain, bridge], pairs), [1, 3, 8])


def test_the_expected_overlap_stays_when_the_world_moves():
    graph = pair_with(random_covariance(np.random.default_rng(4), 0.05, 0.5)).graph
    moved = RigidTransform.from_exp_coords([0.3, -0.2, 1.1, 40, -7, 3]) * graph.trajectory.T_world_sensor
    here, there = (expected_overlap(each.optimize()) for each in (graph, graph.at(moved)))
    assert here == pytest.approx(there, abs=0.02)
