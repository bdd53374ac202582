"""Poses in the layout of kernels, and points scaled to other voxels."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import upload_poses
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.points.voxelize import scaled


def test_rows_of_the_matrix_move_points(device: Device) -> None:
    rng = np.random.default_rng(3)
    R, t, p = Rotation.random(4, rng=rng), rng.normal(0, 20, (4, 3)), rng.normal(0, 9, (4, 3))
    rows = upload_poses(device, R.as_matrix(), t).get().astype(np.float64)
    matrices = rows[:, :12].reshape(4, 3, 4)
    np.testing.assert_allclose(
        np.einsum("kij,kj->ki", matrices[:, :, :3], p) + matrices[:, :, 3], R.apply(p) + t, atol=1e-5
    )
    assert not rows[:, 12:].any()


@pytest.mark.parametrize("count", [0, 257])
def test_positions_are_scaled_and_weights_unchanged(device: Device, count: int) -> None:
    points = np.random.default_rng(count).normal(size=(count, 4)).astype(np.float32)
    given = device.to_device(points)
    got = scaled(device, given, 0.3).get()
    np.testing.assert_allclose(got, points * np.array([0.3, 0.3, 0.3, 1.0], np.float32), rtol=1e-6)
    np.testing.assert_array_equal(given.get(), points)
