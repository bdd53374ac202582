"""Planes of neighbors equal those by SciPy's tree and NumPy's eigenvectors in float64."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.surface.cells import NEIGHBORS, fit_planes, sort_into_cells
from tests.kernels.surface.scenes import bent_sheet

DIRECTIONS = np.array([[0, 0, 1], [0, 0.6, 0.8], [1, 0, 0], [0.6, -0.8, 0]])
VIEWS = np.array([[0, 0, 30.0], [20, -5, 10], [-9, 9, -20]])
FARTHEST, ASIDE = 3.0, 0.4


def twin(points: np.ndarray, views: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, 12) rows as the kernel's, and (m,) which rows rounding to float32 may change."""
    distance, nearest = map(np.asarray, KDTree(points).query(points, min(NEIGHBORS + 1, len(points))))
    tied = np.zeros(len(points), bool)
    if len(points) > NEIGHBORS:
        tied = distance[:, -1] - distance[:, -2] < 1e-5
        nearest = nearest[:, :-1]
    around = points[nearest]
    middle = around.mean(axis=1)
    spread = around - middle[:, None]
    squares, axes = np.linalg.eigh(spread.transpose(0, 2, 1) @ spread)
    normals = axes[:, :, 0]
    height = np.einsum("ni,ni->n", points - middle, normals)
    tied |= (squares[:, 1] - squares[:, 0] < 1e-3 * squares[:, 2]) | (np.abs(np.abs(height) - FARTHEST) < 1e-4)
    height[np.abs(height) > FARTHEST] = 0.0
    smooth = points - height[:, None] * normals
    aside, limit = ((middle - smooth) ** 2).sum(axis=1), ASIDE**2 * squares[:, 1:].sum(axis=1) / nearest.shape[1]
    along = np.sort(np.abs(normals @ DIRECTIONS.T), axis=1)
    tied |= (np.abs(aside - limit) < 1e-4 * limit) | (along[:, -1] - along[:, -2] < 1e-4)
    rows = np.zeros((len(points), 12))
    rows[:, :3], rows[:, 3], rows[:, 4:7] = smooth, aside <= limit, normals
    rows[:, 7] = np.abs(normals @ DIRECTIONS.T).argmax(axis=1)
    if len(views):
        rows[:, 8:11] = smooth - views[np.asarray(KDTree(views).query(smooth)[1])]
    return rows, tied


@pytest.mark.parametrize(("count", "views"), [(900, 3), (20, 0), (3, 1)])
def test_equals_the_twin(device: Device, count: int, views: int) -> None:
    rng = np.random.default_rng(count)
    points = bent_sheet(3 * count, count)[:count].astype(np.float64) + rng.normal(0, 0.2, (count, 3))
    points = points.astype(np.float32).astype(np.float64)
    cells = sort_into_cells(device, points)
    got = fit_planes(device, cells, DIRECTIONS, VIEWS[:views], farthest=FARTHEST, aside=ASIDE).get()
    want, doubtful = twin(points, VIEWS[:views])
    assert doubtful.mean() < 0.02 or count == 3
    clear = ~doubtful
    alike = np.sign(np.einsum("ni,ni->n", got[:, 4:7], want[:, 4:7]))
    np.testing.assert_allclose(alike[clear, None] * got[clear, 4:7], want[clear, 4:7], atol=2e-4)
    np.testing.assert_allclose(got[clear, :3], want[clear, :3], atol=2e-4)
    np.testing.assert_array_equal(got[clear][:, [3, 7]], want[clear][:, [3, 7]])
    near = np.abs(got[:, 8:11] - want[:, 8:11]).max(axis=1) < 2e-4
    assert near[clear].mean() > 0.995  # a point halfway between two viewpoints was seen from either
    np.testing.assert_allclose(np.linalg.norm(got[:, 4:7], axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("kind", ["plane", "line", "point", "far"])
def test_degenerate_points_give_finite_planes(device: Device, kind: str) -> None:
    u = np.random.default_rng(2).uniform(-20, 20, (300, 3))
    points = u * {"plane": (1, 1, 0), "line": (1, 0, 0), "point": (0, 0, 0), "far": (1, 1, 1)}[kind]
    if kind == "far":
        points[:3] *= 3e4
    cells = sort_into_cells(device, points)
    rows = fit_planes(device, cells, DIRECTIONS, np.zeros((0, 3)), farthest=FARTHEST, aside=ASIDE).get()
    assert np.isfinite(rows).all()
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:7], axis=1), 1, atol=1e-6)
    if kind == "plane":
        np.testing.assert_array_equal(np.abs(rows[:, 6]), 1)
    assert not rows[:, 8:11].any()
