"""Voxelization equals its NumPy twin, except for points within float32 rounding of a voxel's boundary."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.launch import affine_rows
from sonarmap.kernels.points.voxelize import voxelize, voxelize_poses
from tests.samples.pomf_twin import occupied
from tests.samples.refusals import refuses


def _points(rng, count, edge, R, offset):
    """Random points, some outside, none whose transform lies within 1e-4 voxel of a boundary."""
    points = rng.uniform(-0.6 * edge, 0.6 * edge, (4 * count, 4)).astype(np.float32)
    points[:, 3] = rng.uniform(0, 5, len(points))
    position = points[:, :3].astype(np.float64) @ R.T + offset + 0.5
    clear = (np.abs(position - np.round(position)) > 1e-4).all(axis=1)
    return np.ascontiguousarray(points[clear][:count])


@pytest.mark.parametrize(("edge", "count"), [(16, 1), (32, 5000), (64, 3001)])
def test_equals_the_twin(device, edge, count):
    rng = np.random.default_rng(edge)
    R = Rotation.from_euler("ZYX", [31, -12, 7], degrees=True).as_matrix()
    offset = np.array([1.25, -3.5, 0.75])
    points = _points(rng, count, edge, R, offset)
    volume = voxelize(device, device.to_device(points), edge, R, offset).get()
    np.testing.assert_array_equal(volume, occupied(points[:, :3] @ R.T + offset, edge, points[:, 3]))


def test_order_of_points_does_not_matter_and_out_is_cleared(device):
    rng = np.random.default_rng(3)
    points = rng.normal(0, 4, (20000, 4)).astype(np.float32)
    points[:, 3] = np.abs(points[:, 3])
    first = voxelize(device, device.to_device(points), 32)
    want = first.get()
    again = voxelize(device, device.to_device(points[::-1].copy()), 32, out=first)
    assert again is first
    np.testing.assert_array_equal(again.get(), want)


def test_voxel_centers_and_boundaries(device):
    points = np.array(
        [[0, 0, 0, 1], [-8, 7.25, 1.5, 2], [7.5, 0, 0, 3], [-8.6, 0, 0, 4], [np.nan, 0, 0, 5], [1, 1, 1, -1]],
        np.float32,
    )
    volume = voxelize(device, device.to_device(points), 16).get()
    assert np.argwhere(volume).tolist() == [[0, 15, 10], [8, 8, 8]]
    assert volume[0, 15, 10] == 2
    assert not voxelize(device, device.empty((1, 4))[:0], 16).get().any()


def test_batch_of_poses_equals_single_poses(device):
    """Each block of 8 rows is marked if it contains a point."""
    rng = np.random.default_rng(5)
    cloud = np.column_stack([rng.uniform(-12, 12, (300, 3)), rng.uniform(-0.5, 2, 300)]).astype(np.float32)
    points, edge = device.to_device(cloud), 16
    turns = Rotation.random(3, rng=rng).as_matrix()
    offsets = rng.uniform(-3, 3, (3, 3))
    rows = np.zeros((3, 20), np.float32)
    for row, R, offset in zip(rows, turns, offsets, strict=True):
        row[:16] = affine_rows(R, offset + edge / 2 + 0.5).ravel()
    volumes = device.to_device(np.zeros((2, edge, edge, edge), np.float32))
    marks = device.to_device(np.zeros((2, edge * edge // 8), np.int32))
    voxelize_poses(device, points, volumes, marks, device.to_device(rows), 1, 2)
    for n, (R, offset) in enumerate(zip(turns[1:], offsets[1:], strict=True)):
        want = voxelize(device, points, edge, R, offset).get()
        np.testing.assert_array_equal(volumes.get()[n], want)
        np.testing.assert_array_equal(marks.get()[n] > 0, want.reshape(edge * edge // 8, -1).any(axis=1))
    refuses("marks", voxelize_poses, device, points, volumes, marks[:1], device.to_device(rows), 1, 2)
