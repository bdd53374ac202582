"""Which scans occupy the same cells: the predicted overlap of scans."""

from dataclasses import replace

import numpy as np
import pytest

from sonarmap.slam.map import cell
from sonarmap.slam.map.cell import cell_keys, outline, overlapping
from tests.samples.surveys import random_transforms, ring_poses, scans_of


def test_predicted_overlap_is_the_smaller_of_both_ways():
    truth = ring_poses(6, radius=8.0)
    scans = scans_of(truth)
    half = replace(scans[1], points=scans[1].points[scans[1].points[:, 0] > 0])
    outlines = [outline(scan, 2.0) for scan in (scans[0], scans[1], half)]
    pairs, share = overlapping(outlines, truth[[0, 1, 1]], 2.0, 1e-6)
    assert pairs.tolist() == [[0, 1], [1, 2]]
    assert 0.4 < share[1] < 0.7  # all of the half lies in the whole, half of the whole in the half
    assert 0 < share[0] < 1
    few, large = overlapping(outlines, truth[[0, 1, 1]], 2.0, float(share[1]))
    np.testing.assert_array_equal(few, pairs[share >= share[1]])
    np.testing.assert_array_equal(large, share[share >= share[1]])


def test_the_shares_are_those_of_sets_of_cells_however_many_scans_there_are(monkeypatch: pytest.MonkeyPatch):
    rng = np.random.default_rng(4)
    outlines = [rng.uniform(-3, 3, (int(rng.integers(1, 60)), 3)) for _ in range(23)]
    truth = random_transforms(rng, 23, 0.5, 3.0)
    origin = np.floor(np.median(truth[0].apply(outlines[0]), axis=0))
    cells = [{tuple(np.floor(p - origin)) for p in T.apply(points)} for points, T in zip(outlines, truth, strict=True)]
    wanted = {
        (i, j): len(cells[i] & cells[j]) / max(len(cells[i]), len(cells[j]))
        for i in range(23)
        for j in range(i + 1, 23)
        if cells[i] & cells[j]
    }
    for together in (4, 500):
        monkeypatch.setattr(cell, "_TOGETHER", together)
        pairs, share = overlapping(outlines, truth, 1.0, 1e-6)
        assert [tuple(pair) for pair in pairs.tolist()] == sorted(wanted)
        np.testing.assert_allclose(share, [wanted[i, j] for i, j in pairs.tolist()], rtol=1e-12)


def test_a_stray_point_does_not_disturb_the_predicted_overlap():
    truth = ring_poses(6, radius=8.0)
    scans = scans_of(truth)[:2]
    stray = np.array([[99_000, 0, 0]], np.float32)
    struck = [replace(scan, points=np.vstack([stray, scan.points])) for scan in scans]
    clean, other = (overlapping([outline(one, 0.05) for one in of], truth[:2], 0.05, 1e-6)[1] for of in (scans, struck))
    np.testing.assert_allclose(other, clean, atol=2e-3)


def test_cells_are_half_open_and_ordered():
    points = np.array([[0.0, 0, 0], [0.999, 0, 0], [1.0, 0, 0], [-1e-9, 0, 0], [0, 1, 0], [0, 0, 1]])
    keys, near = cell_keys(points, 1.0, np.zeros(3))
    assert near.all()
    assert keys[0] == keys[1]
    assert keys[3] < keys[0] < keys[5] < keys[4] < keys[2]
