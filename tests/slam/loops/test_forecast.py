"""How much of an expected overlap is left where the poses are uncertain."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.loops.forecast import certainties, displacement
from sonarmap.slam.map.cell import outline
from tests.samples.surveys import chain_edges, chained_graph, random_covariance, ring_poses, scans_of

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


def test_the_forecast_asks_only_for_what_is_between_the_scans():
    """The world may be moved."""
    graph = pair_with(random_covariance(np.random.default_rng(4), 0.05, 0.5)).graph
    moved = RigidTransform.from_exp_coords([0.3, -0.2, 1.1, 40, -7, 3]) * graph.trajectory.T_world_sensor
    here, there = (forecast(each.optimize()) for each in (graph, graph.at(moved)))
    assert here == pytest.approx(there, abs=0.02)


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
