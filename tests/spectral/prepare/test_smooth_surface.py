"""The surface of a scan: smoothing removes noise along normals and moves neither walls nor stray points."""

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.spectral.prepare.surface import smoothed_further
from tests.spectral.surfaces import chosen_device, surface_of

TURN = Rotation.from_euler("ZYX", [40, -25, 12], degrees=True)


def noisy_plane() -> np.ndarray:
    """Points (900, 3), one per voxel, on z = 0 with noise along z [voxels]."""
    x, y = np.meshgrid(np.arange(-15.0, 15.0), np.arange(-12.0, 18.0), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.random.default_rng(1).normal(0, 0.4, x.size)])


def test_noise_along_the_normal_is_averaged() -> None:
    surface = surface_of(noisy_plane())
    assert surface.points[:, 2].std() < 0.5 * noisy_plane()[:, 2].std()
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-6)
    assert np.median(np.abs(surface.normals[:, 2])) > np.cos(np.deg2rad(12))


def test_further_smoothing_reduces_noise_of_heights_and_normals() -> None:
    surface = surface_of(noisy_plane(), [np.array([0.0, 0.0, 20.0])])
    smoother = smoothed_further(chosen_device(), surface)
    assert len(smoother) == 3
    middle = (np.abs(surface.points[:, :2] - [0.0, 3.0]) < 9).all(axis=1)
    for more, less in pairwise([*smoother, surface]):
        assert more.points[middle, 2].std() < 0.9 * less.points[middle, 2].std()
        assert more.normals[middle, :2].std() < 0.85 * less.normals[middle, :2].std()
        np.testing.assert_array_equal(more.rays, surface.rays)
        np.testing.assert_array_equal(more.elements.rows.get().reshape(more.rows.shape), more.rows)


def test_after_further_smoothing_points_near_a_rim_are_rim_points() -> None:
    x, y = np.meshgrid(np.arange(20.0), np.arange(16.0))
    surface = surface_of(np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]))
    for smooth in smoothed_further(chosen_device(), surface):
        inner = smooth.inner.reshape(x.shape)
        assert inner[4:-4, 4:-4].all()
        assert not np.delete(inner, np.s_[3:-3], axis=0).any()
        assert not np.delete(inner, np.s_[3:-3], axis=1).any()


def test_few_points_suffice_and_the_cells_hold_the_smoothed_points() -> None:
    surface = surface_of(np.array([[0.0, 0, 1], [2, 0, 1], [0, 3, 1]]))
    np.testing.assert_allclose(np.abs(surface.normals[:, 2]), 1)
    surface = surface_of(noisy_plane())
    rows = surface.elements.cells.points.get()
    np.testing.assert_array_equal(rows[:, :3], surface.points[rows[:, 3].copy().view(np.int32)])
