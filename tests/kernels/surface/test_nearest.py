"""Nearest points equal those of SciPy's tree, except for rounding."""

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import upload_places
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.surface.cells import find_nearest, sort_into_cells
from tests.kernels.surface.scenes import bent_sheet

# Coordinates of 100 voxels have rounding errors of 4e-6.
ROUNDING = 3e-5
STILL = np.eye(3)[None], np.zeros((1, 3))


def cloud(shape: str, count: int) -> np.ndarray:
    rng = np.random.default_rng(count)
    if shape == "surface":
        return bent_sheet(3 * count, count)[:count]
    extents = {"ball": (12, 12, 12), "sparse": (90, 90, 90), "plane": (40, 30, 0), "line": (0, 0, 60)}
    return (rng.uniform(-1, 1, (count, 3)) * extents[shape] + [3, -2, 1]).astype(np.float32)


def require_nearest(device: Device, points: np.ndarray, places: np.ndarray, count: int, reach: float) -> None:
    """Require that the kernel and the tree find the same neighbors at some poses."""
    rng = np.random.default_rng(7)
    R, t = Rotation.random(count, rng=rng).as_matrix(), rng.uniform(-4, 4, (count, 3))
    cells = sort_into_cells(device, points)
    distance, index = find_nearest(device, cells, upload_places(device, places), R, t, reach)
    moved = places @ R.transpose(0, 2, 1) + t[:, None]
    want, _ = KDTree(points).query(moved)
    assert distance.shape == index.shape == (count, len(places))
    away = ROUNDING * (1 + np.abs(moved).max() / 100)
    clear = np.abs(want - reach) > away
    np.testing.assert_array_equal(np.isfinite(distance)[clear], (want <= reach)[clear])
    np.testing.assert_array_equal(index < 0, ~np.isfinite(distance))
    near = index >= 0
    np.testing.assert_allclose(distance[near], want[near], atol=away)
    np.testing.assert_allclose(np.linalg.norm(points[index[near]] - moved[near], axis=1), want[near], atol=away)


@pytest.mark.parametrize("reach", [0.0, 1.5, 60.0])
@pytest.mark.parametrize(
    ("shape", "count", "poses"),
    [
        ("surface", 3000, 3),
        ("surface", 3, 72),
        ("sparse", 500, 2),
        ("line", 60, 2),
    ],
)
def test_equals_the_twin(device: Device, shape: str, count: int, poses: int, reach: float) -> None:
    places = np.random.default_rng(3).uniform(-45, 45, (257, 3))
    require_nearest(device, cloud(shape, count), places, poses, reach)


@pytest.mark.parametrize("reach", [2.0, 700.0])
def test_far_outliers_and_queries_far_outside(device: Device, reach: float) -> None:
    points = np.vstack([cloud("surface", 800), [[4e5, 0, 3], [0, -9e5, 0], [30, 30, 1e6]]]).astype(np.float32)
    rng = np.random.default_rng(5)
    places = np.vstack([rng.uniform(-30, 30, (100, 3)), [[3e5, 0, 0], [-500, 40, 0], [1e6, 1e6, -1e6]]])
    distance, index = find_nearest(
        device, sort_into_cells(device, points), upload_places(device, places), *STILL, reach
    )
    want, _ = KDTree(points).query(places)
    np.testing.assert_array_equal(index[0] >= 0, want <= reach)
    np.testing.assert_allclose(distance[0][index[0] >= 0], want[want <= reach], rtol=1e-5, atol=1e-4)
    many = rng.uniform(-250, 250, (200_000, 3)).astype(np.float32)
    require_nearest(device, many, many[:500].astype(np.float64) + 0.3, 1, 8.0)


def test_ties_take_the_first_point_in_the_cells_and_nan_has_no_neighbor(device: Device) -> None:
    points = np.array([[1, 0, 0], [-1, 0, 0], [0, 2, 0]], np.float32)
    places = upload_places(device, np.array([[0, 0, 0], [0, 0, 1.5], [np.nan, 0, 0], [0, np.inf, 0]]))
    cells = sort_into_cells(device, points)
    distance, index = find_nearest(device, cells, places, *STILL, 1.0)
    assert index[0].tolist() == [1, -1, -1, -1]
    assert distance[0].tolist() == [1.0, np.inf, np.inf, np.inf]
    assert find_nearest(device, cells, places, np.zeros((0, 3, 3)), np.zeros((0, 3)), 1.0)[0].shape == (0, 4)
    assert find_nearest(device, cells, places[:0], *STILL, 1.0)[1].shape == (1, 0)
