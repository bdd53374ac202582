"""Poses as kernels take them."""

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.points.poses import upload_poses
from tests.samples.refusals import refuses


def test_rows_of_the_matrix_move_points(device: Device) -> None:
    rng = np.random.default_rng(3)
    R, t, p = Rotation.random(4, rng=rng), rng.normal(0, 20, (4, 3)), rng.normal(0, 9, (4, 3))
    rows = upload_poses(device, R.as_matrix(), t).get().astype(np.float64)
    matrices = rows[:, :12].reshape(4, 3, 4)
    np.testing.assert_allclose(
        np.einsum("kij,kj->ki", matrices[:, :, :3], p) + matrices[:, :, 3], R.apply(p) + t, atol=1e-5
    )
    assert not rows[:, 12:].any()


def test_refuses_what_is_no_pose(device: Device) -> None:
    refuses("finite", upload_poses, device, np.eye(3)[None], np.array([[0, np.inf, 0]]))
    refuses("`R` and `t` have shapes", upload_poses, device, np.eye(3)[None], np.zeros((2, 3)))
