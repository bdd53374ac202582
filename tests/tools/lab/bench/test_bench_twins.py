"""The twins against direct double precision; what the kernels are held against must be right itself."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.resample.sphere import rectangular_unwrap
from sonarmap.kernels.so3.correlation import wigner_d
from sonarmap.tools.lab.bench import twins
from sonarmap.tools.lab.bench.rotation_cases import wigner_table
from sonarmap.tools.lab.bench.workload import BANDWIDTH, R, Workload


class TestTwins:
    def test_sample(self) -> None:
        magnitude = np.random.default_rng(2).random((16, 16, 9), dtype=np.float32)
        directions, radii = rectangular_unwrap(8, "y"), np.array([2.0, 5.5], np.float32)
        got = twins.sample(magnitude, directions, radii, R, 2)
        turned = R @ directions[5, 3].astype(np.float64)
        turned *= np.sign(turned[2])
        want = [map_coordinates(magnitude, (turned * r + [8, 8, 0])[:, None], order=1)[0] for r in radii]
        np.testing.assert_allclose(got[:, 5, 3], want, rtol=1e-5)

    def test_voxelize_keeps_the_largest_weight(self) -> None:
        points = np.array([[1, 2, 3, 0.5], [1.2, 2, 3, 0.9], [100, 0, 0, 1]], np.float32)
        volume = twins.voxelize(points, np.eye(3), np.ones((16, 16, 16), np.float32))
        assert np.argwhere(volume).tolist() == [[9, 10, 11]]
        assert volume[9, 10, 11] == np.float32(0.9)

    def test_normalize_layers(self) -> None:
        stack = np.random.default_rng(4).random((3, 8, 8), dtype=np.float32)
        mask = np.ones((8, 8), np.float32)
        mask[0] = 0
        got = twins.normalize_layers(stack, np.full((8, 8), 2, np.float32), mask)
        np.testing.assert_allclose(got[:, 1:].mean(axis=(1, 2)), 0, atol=1e-5)
        np.testing.assert_allclose(got[:, 1:].std(axis=(1, 2)), 2, rtol=1e-5)
        assert not got[:, 0].any()

    def test_correlate_rotations(self, device: Device) -> None:
        """Against the sum of the formula at one rotation, in double precision."""
        workload = Workload(device, 16, 1, 8)
        target, source = workload.coefficients
        betas, edge = np.array([0.3, 1.1]), 128
        got = twins.correlate_rotations(target, source, wigner_table(betas), edge, 1)
        assert not got[2].any()
        orders = np.arange(1 - BANDWIDTH, BANDWIDTH)
        want = 0.0
        for half in range(BANDWIDTH // 2):
            part = np.abs(orders) <= 2 * half
            a, b = (array[half, :, part].astype(np.complex128) for array in (target, source))
            wave = a * np.exp(2j * np.pi * 17 / edge * orders[part])[:, None]
            want += np.einsum(
                "ml,mn,nl->",
                wave,
                wigner_d(2 * half, betas[1:])[0],
                b.conj() * np.exp(2j * np.pi * 90 / edge * orders[part])[:, None],
            ).real
        scale = float(np.linalg.norm(target) * np.linalg.norm(source))
        assert got[1, 17, 90] == pytest.approx(want, abs=1e-6 * scale)

    def test_segment_peaks(self) -> None:
        volume = np.zeros((4, 5, 12), np.float32) + np.arange(12, dtype=np.float32) / 100
        volume[1, 2, 1], volume[3, 4, 2], volume[3, 4, 7], volume[3, 4, 11] = 3, 4, 5, 4.5
        np.testing.assert_array_equal(twins.segment_peaks(volume, 2)[:3], [[3, 4, 7, 5], [3, 4, 2, 4], [1, 2, 1, 3]])

    def test_nearest_by_hand(self) -> None:
        points = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0]], np.float32)
        got = twins.nearest(
            KDTree(points), points, np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([0, 0, 1.0]), 1
        )
        # (0, 0, 0) -> (0, 0, 1), (3, 0, 0) -> (0, 3, 1), (0, 4, 0) -> (-4, 0, 1)
        np.testing.assert_allclose(got, [1, np.sqrt(2), np.sqrt(17)], rtol=1e-6)

    def test_points_move_onto_their_plane(self) -> None:
        """Points of z = 0.1 x stay where they are, and so does one that is 5 off it."""
        x, y = np.meshgrid(np.arange(6.0), np.arange(6.0))
        points = np.column_stack([x.ravel(), y.ravel(), 0.1 * x.ravel()]).astype(np.float32)
        got = twins.on_planes(KDTree(points), points, 9, 2.0, 1)
        np.testing.assert_allclose(got, points, atol=1e-5)
        points[14, 2] += 5
        far = twins.on_planes(KDTree(points[:, :3]), points, 36, 2.0, 1)
        np.testing.assert_allclose(far[14], points[14], atol=1e-6)  # farther than 2: it stays

    def test_agreement(self) -> None:
        """Along +z, of which the cells of the middle are seen from 10 to 12; moved there by the pose alone."""
        view = np.full((4, 4, 2), (np.inf, -np.inf), np.float32)
        view[1:3, 1:3] = 10, 12
        points = np.array([[5, 0, 0], [8, 0, 0], [9.5, 0, 0], [30, 0, 0], [-9, 0, 0]], np.float32)
        R = Rotation.from_euler("y", -90, degrees=True).as_matrix()  # x to z
        assert twins.agreement(view, points, R[None], np.array([[0.1, 0.1, 2]]), 1.0, 0.0).tolist() == [[2, 1, 4]]

    def test_the_workload_depends_on_the_seed_alone(self, device: Device) -> None:
        first, again, other = (Workload(device, 16, 1, seed) for seed in (1, 1, 2))
        np.testing.assert_array_equal(first.points, again.points)
        np.testing.assert_array_equal(first.volume, again.volume)
        assert not np.array_equal(first.volume, other.volume)
