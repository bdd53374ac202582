"""Which scans occupy the same cells: the predicted overlap of scans."""

from dataclasses import replace

import numpy as np

from slam.map.shared_cells import outline, predict_overlap
from tests.samples.surveys import ring_poses, scans_of


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
