"""The packing of points."""

import numpy as np
from scipy.spatial import KDTree

from sonarmap.tools.products.report.points import FRACTION, codes, pack
from tests.tools.products.report.known_map import unpack

VOXEL = 0.25
FINE = VOXEL / FRACTION


def surface(count: int, seed: int = 4) -> np.ndarray:
    """One random point in each voxel of a wavy bed, far from the origin."""
    rng = np.random.default_rng(seed)
    side = int(np.sqrt(count))
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(side), np.arange(side), indexing="ij"))
    z = np.floor(20 * np.sin(x / 40) + 12 * np.cos(y / 25))
    return np.array([480_000.0, -1_200.0, -35.0]) + VOXEL * (np.column_stack([x, y, z]) + rng.random((side * side, 3)))


def test_points_are_unpacked_within_half_a_quantum_with_their_columns() -> None:
    points = surface(20_000)
    rng = np.random.default_rng(1)
    columns = {"seen": rng.integers(0, 256, len(points)), "scan": rng.integers(0, 70_000, len(points))}
    data, layout = pack(points, columns, VOXEL)
    back, same = unpack(data, layout)
    off, which = KDTree(points).query(back)
    np.testing.assert_array_equal(np.sort(which), np.arange(len(points)))
    assert np.abs(back - points[which]).max() <= FINE / 2 + 1e-9
    assert off.max() > FINE / 4  # quantization does change the points
    assert layout["planes"] == {"seen": 1, "scan": 3}
    for name, values in columns.items():
        np.testing.assert_array_equal(same[name], values[which])


def test_codes_are_logarithmic() -> None:
    """From 2 to 32 the geometric mean 8 is in the middle; values that are not positive and finite have code 0."""
    values, (low, high) = codes(np.array([2.0, 8.0, 32.0, 0.0, np.nan, -1.0, np.inf]))
    assert values.tolist() == [1, 128, 255, 0, 0, 0, 0]
    assert (low, high) == (2.0, 32.0)
    assert codes(np.array([np.nan]))[0].tolist() == [0]
    assert codes(np.array([5.0, 5.0]))[0].tolist() == [1, 1]


def test_packing_a_surface_is_compact_and_reproducible() -> None:
    """About three bytes a point: six bits an axis within the voxel, and little for the voxel itself."""
    points = surface(60_000)
    data, layout = pack(points, {}, VOXEL)
    assert len(data) / len(points) < 3.3
    assert (data, layout) == pack(points.copy(), {}, VOXEL)
