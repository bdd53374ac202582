"""How much of an expected overlap is left where the poses are uncertain."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.pose_graph import PoseGraph, Solution
from sonarmap.slam.graph.trajectory import chain
from sonarmap.slam.loops.forecast import certainties, displacement
from sonarmap.slam.map.cell import outline
from sonarmap.spectral.scan import Scan
from tests.samples.surveys import edge, random_covariance, ring_poses, scans_of


def pair_with(covariance: np.ndarray) -> Solution:
    """Two scans, the second measured from the first with this covariance."""
    truth = ring_poses(6, radius=8.0)[:2]
    edges = (edge(0, 1, truth[0].inv() * truth[1], covariance),)
    return PoseGraph(chain(edges, np.zeros(2)), edges).optimize()


def forecast(scans: list[Scan], solution: Solution) -> float:
    pair = np.array([[0, 1]])
    return float(certainties([outline(scan, 1.0) for scan in scans], pair, *solution.relatives(pair), 1.0)[0])


def test_a_sure_pose_leaves_the_overlap_and_an_unsure_one_takes_from_it():
    scans = scans_of(ring_poses(6, radius=8.0))[:2]
    covariance = random_covariance(np.random.default_rng(3), 1e-4, 1e-3)
    left = [forecast(scans, pair_with(scale * covariance)) for scale in (1, 1e5, 1e8)]
    assert left[0] > 0.97
    assert 1 > left[1] > left[2] + 0.1


def test_the_forecast_asks_only_for_what_is_between_the_scans():
    """The world may be moved."""
    scans = scans_of(ring_poses(6, radius=8.0))[:2]
    covariance = random_covariance(np.random.default_rng(4), 0.05, 0.5)
    truth = ring_poses(6, radius=8.0)[:2]
    edges = (edge(0, 1, truth[0].inv() * truth[1], covariance),)
    moved = chain(edges, np.zeros(2))
    moved = replace(
        moved, T_world_sensor=RigidTransform.from_exp_coords([0.3, -0.2, 1.1, 40, -7, 3]) * moved.T_world_sensor
    )
    solutions = [pair_with(covariance), PoseGraph(moved, edges).optimize()]
    here, there = (forecast(scans, solution) for solution in solutions)
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
