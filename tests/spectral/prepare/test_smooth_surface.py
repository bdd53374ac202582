"""The surface of a scan: noise along the normals goes, walls stay where they are, and so do wild points."""

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from spectral.prepare.surface import Surface, smooth_surface

TURN = Rotation.from_euler("ZYX", [40, -25, 12], degrees=True)


def noisy_plane(sigma: float = 0.4) -> np.ndarray:
    """(900, 3) points, one a voxel, on z = 0 but for noise along z [voxels]."""
    x, y = np.meshgrid(np.arange(-15.0, 15.0), np.arange(-12.0, 18.0), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.random.default_rng(1).normal(0, sigma, x.size)])


def smoothed(points: np.ndarray) -> Surface:
    return smooth_surface(points, KDTree(points))


def test_noise_along_the_normal_is_averaged() -> None:
    surface = smoothed(noisy_plane())
    assert surface.points[:, 2].std() < 0.5 * noisy_plane()[:, 2].std()
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-12)
    assert np.median(np.abs(surface.normals[:, 2])) > np.cos(np.deg2rad(12))


def test_points_on_a_plane_stay_on_it() -> None:
    plane = TURN.apply(noisy_plane(0.0)) + np.array([3.0, -7.0, 2.0])
    surface = smoothed(plane)
    np.testing.assert_allclose(surface.points, plane, atol=1e-9)
    np.testing.assert_allclose(np.abs(surface.normals @ TURN.apply([0, 0, 1])), 1, atol=1e-9)


def test_turning_the_points_turns_the_surface() -> None:
    plain, turned = smoothed(noisy_plane()), smoothed(TURN.apply(noisy_plane()) + np.array([5.0, 1.0, -2.0]))
    np.testing.assert_allclose(turned.points, TURN.apply(plain.points) + np.array([5.0, 1.0, -2.0]), atol=1e-6)
    np.testing.assert_allclose(np.abs(np.sum(TURN.apply(plain.normals) * turned.normals, axis=1)), 1, atol=1e-6)


@pytest.mark.parametrize(("height", "moves"), [(2.0, True), (9.0, False)])
def test_a_point_far_off_its_neighbors_plane_stays(height: float, moves: bool) -> None:
    points = np.vstack([noisy_plane(0.0), [0.5, 0.5, height]])
    left = np.abs(smoothed(points).points[-1] - points[-1]).max()
    assert (left > 1.0) == moves
    assert moves or left < 0.1


def test_few_points_will_do() -> None:
    surface = smoothed(np.array([[0.0, 0, 1], [2, 0, 1], [0, 3, 1]]))
    np.testing.assert_allclose(np.abs(surface.normals[:, 2]), 1)


def test_the_tree_is_of_the_smoothed_points() -> None:
    surface = smoothed(noisy_plane())
    np.testing.assert_array_equal(surface.tree.data, surface.points)


def test_points_at_a_rim_have_their_neighbors_on_one_side() -> None:
    x, y = np.meshgrid(np.arange(20.0), np.arange(12.0))
    surface = smoothed(np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]))
    inner = surface.inner.reshape(x.shape)
    assert inner[3:-3, 3:-3].all()
    assert not inner[[0, -1]].any()
    assert not inner[:, [0, -1]].any()
