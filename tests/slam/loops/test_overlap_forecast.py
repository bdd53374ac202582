"""What two scans are expected to share: at the estimate, and where the poses are unsure."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from slam.graph.pose_graph import PoseGraph, Solution
from slam.graph.trajectory import chain
from slam.loops.forecast import outline, predict_overlap, sureness
from spectral.scan import Scan
from tests.samples.surveys import edge, random_covariance, ring_poses, scans_of


def test_predicted_overlap_is_the_smaller_of_both_ways():
    truth = ring_poses(6, radius=8.0)
    scans = scans_of(truth)
    half = replace(scans[1], points=scans[1].points[scans[1].points[:, 0] > 0])
    overlap = predict_overlap([outline(scan, 2.0) for scan in (scans[0], scans[1], half)], truth[[0, 1, 1]], 2.0)
    np.testing.assert_array_equal(overlap, overlap.T)
    np.testing.assert_array_equal(np.diag(overlap), 1)
    assert 0.4 < overlap[1, 2] < 0.7  # all of the half lies in the whole, half of the whole in the half
    assert 0 < overlap[0, 1] < 1


def test_a_stray_point_does_not_disturb_the_predicted_overlap():
    truth = ring_poses(6, radius=8.0)
    scans = scans_of(truth)[:2]
    stray = np.array([[99_000, 0, 0]], np.float32)
    struck = [replace(scan, points=np.vstack([stray, scan.points])) for scan in scans]
    clean, other = (predict_overlap([outline(one, 0.05) for one in of], truth[:2], 0.05) for of in (scans, struck))
    np.testing.assert_allclose(other, clean, atol=2e-3)


def pair_with(covariance: np.ndarray) -> Solution:
    """Two scans, the second measured from the first with this covariance."""
    truth = ring_poses(6, radius=8.0)[:2]
    edges = (edge(0, 1, truth[0].inv() * truth[1], covariance),)
    return PoseGraph(chain(edges, np.zeros(2)), edges).optimize()


def forecast(scans: list[Scan], solution: Solution) -> float:
    target, source = (outline(scan, 1.0) for scan in scans)
    return sureness(target, source, *solution.relative(0, 1), 1.0)


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
