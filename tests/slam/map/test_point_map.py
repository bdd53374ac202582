"""The fused map compared with a dictionary of voxels; the cells of points, and the predicted overlap of scans."""

from collections import Counter, defaultdict
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.map import point_map as point_maps
from sonarmap.slam.map.cell import cell_keys, outline, overlapping
from sonarmap.slam.map.placed import PlacedScans
from sonarmap.slam.map.point_map import fuse
from sonarmap.spectral.point_store import PointStore
from sonarmap.spectral.scan import Scan
from tests.samples.surveys import random_transforms, ring_poses, scans_of


def random_scans(rng: np.random.Generator, count: int) -> list[Scan]:
    """Scans of random points, every third one without echo strengths."""
    scans = []
    for k in range(count):
        points = (rng.normal(size=(60 + 20 * k, 3)) * [2, 1.5, 1]).astype(np.float32)
        strength = rng.uniform(0, 9, len(points)).astype(np.float32) if k % 3 else None
        scans.append(Scan(points, strength, name=f"scan{k}"))
    return scans


@pytest.mark.parametrize("merge_rows", [1, 1_000_000])
def test_a_map_agrees_with_a_dictionary_of_voxels(merge_rows, monkeypatch):
    monkeypatch.setattr(point_maps, "MERGE_ROWS", merge_rows)
    rng = np.random.default_rng(0)
    scans, voxel = random_scans(rng, 7), 0.4
    T = random_transforms(rng, 7, angle=0.5, length=1.0)
    indices = [3, 4, 8, 9, 11, 12, 20]
    fused = fuse(PlacedScans.of(scans, T, voxel, indices))

    origin = np.floor(T.translation[0] / voxel) * voxel
    voxels = defaultdict(list)
    for scan, index, pose in zip(scans, indices, T, strict=True):
        points = pose.apply(scan.points.astype(np.float64))
        strength = scan.strength if scan.strength is not None else np.full(len(points), np.nan)
        for point, echo in zip(points, strength, strict=True):
            voxels[tuple(np.floor((point - origin) / voxel).astype(int))].append((index, point, echo))
    assert len(fused.points) == len(voxels)
    assert fused.strength is not None
    for k, at in enumerate(sorted(voxels)):
        held, points, echoes = (list(column) for column in zip(*voxels[at], strict=True))
        counts = Counter(held)
        np.testing.assert_allclose(fused.points[k], np.mean(points, axis=0), atol=1e-12)
        assert fused.count[k] == len(held)
        assert fused.seen[k] == len(counts)
        assert fused.scan[k] == min(counts, key=lambda index: (-counts[index], index))
        known = [echo for echo in echoes if not np.isnan(echo)]
        np.testing.assert_allclose(fused.strength[k], np.mean(known) if known else np.nan, rtol=1e-6)


def test_a_map_far_from_the_origin_is_as_exact():
    """UTM coordinates: millions of meters with centimeters in them."""
    scan = random_scans(np.random.default_rng(1), 1)
    far = RigidTransform.from_translation([[500_000.0, 4_600_000.0, -20.0]])
    near = fuse(PlacedScans.of(scan, RigidTransform.identity(1), 0.05))
    np.testing.assert_allclose(
        fuse(PlacedScans.of(scan, far, 0.05)).points - far.translation[0], near.points, atol=1e-8
    )


@pytest.mark.parametrize(("scans", "poses", "voxel"), [(1, 2, 0.5), (1, 1, float("nan")), (1, 1, 1e-7)])
def test_refuses_invalid_poses_and_voxels(scans, poses, voxel):
    with pytest.raises(InputError):
        fuse(PlacedScans.of(random_scans(np.random.default_rng(2), scans), RigidTransform.identity(poses), voxel))


@pytest.mark.parametrize("where", ["first", "last"])
def test_a_stray_point_is_left_out_and_counted(where):
    scans = random_scans(np.random.default_rng(3), 2)
    stray = np.array([[99_000, 0, 0]], np.float32)
    k = 0 if where == "first" else -1
    scans[k] = replace(scans[k], points=np.vstack([stray, scans[k].points]), strength=None)
    fused = fuse(PlacedScans.of(scans, RigidTransform.identity(2), 0.02))
    assert fused.left_out == 1
    assert fused.count.sum() == sum(len(scan.points) for scan in scans) - 1
    assert np.abs(fused.points).max() < 20
    assert fuse(PlacedScans.of(scans, RigidTransform.identity(2), 0.5)).left_out == 0


def test_scans_far_from_their_sensor_are_mapped_whole():
    """100 km off, at a voxel of 2 cm: five million cells."""
    scan = random_scans(np.random.default_rng(4), 1)[0]
    moved = replace(scan, points=scan.points + np.array([9e4, -1e5, 0], np.float32))
    fused = fuse(PlacedScans.of([moved], RigidTransform.identity(1), 0.02))
    assert fused.left_out == 0
    assert fused.count.sum() == len(scan.points)


def test_predicted_overlaps_agree_with_sets_of_cells():
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
    pairs, share = overlapping(outlines, truth, 1.0, 1e-6)
    assert [tuple(pair) for pair in pairs.tolist()] == sorted(wanted)
    np.testing.assert_allclose(share, [wanted[i, j] for i, j in pairs.tolist()], rtol=1e-12)
    few, large = overlapping(outlines, truth, 1.0, float(np.median(share)))
    np.testing.assert_array_equal(few, pairs[share >= np.median(share)])
    np.testing.assert_array_equal(large, share[share >= np.median(share)])


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


def test_scans_need_no_strength():
    T = ring_poses(6)
    assert fuse(PlacedScans.of(scans_of(T), T, 0.5)).strength is None


def test_the_map_of_scans_on_disk_is_the_same():
    store, T = PointStore(0), ring_poses(6)
    scans = [replace(scan, strength=None) for scan in scans_of(T)]
    on_disk = [replace(scan, points=store.keep(scan.points)) for scan in scans]
    here, there = (fuse(PlacedScans.of(each, T, 0.5)) for each in (scans, on_disk))
    for name in ("points", "sigma", "scan", "seen", "count"):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name), name)
