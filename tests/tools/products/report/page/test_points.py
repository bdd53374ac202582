"""The points of a page: what is packed comes back within half a quantum, and takes few bytes."""

import gzip

import numpy as np
import pytest
from scipy.spatial import KDTree

from sonarmap.tools.products.report.page.points import FRACTION, TILE, codes, pack, unpack

VOXEL = 0.25
QUANTUM = VOXEL / FRACTION


def surface(count: int, seed: int = 4) -> np.ndarray:
    """One point for each voxel of a wavy bed, ragged within the voxel, far from the origin."""
    rng = np.random.default_rng(seed)
    side = int(np.sqrt(count))
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(side), np.arange(side), indexing="ij"))
    z = np.floor(20 * np.sin(x / 40) + 12 * np.cos(y / 25))
    return np.array([480_000.0, -1_200.0, -35.0]) + VOXEL * (np.column_stack([x, y, z]) + rng.random((side * side, 3)))


def test_points_come_back_within_half_a_quantum_with_their_columns() -> None:
    points = surface(20_000)
    rng = np.random.default_rng(1)
    columns = {"seen": rng.integers(0, 256, len(points)), "scan": rng.integers(0, 70_000, len(points))}
    packed = pack(points, columns, VOXEL)
    back, same = unpack(packed)
    off, which = KDTree(points).query(back)
    np.testing.assert_array_equal(np.sort(which), np.arange(len(points)))
    assert np.abs(back - points[which]).max() <= QUANTUM / 2 + 1e-9
    assert off.max() > QUANTUM / 4  # or the test would have nothing to find
    assert packed.planes == {"seen": 1, "scan": 3}
    for name, values in columns.items():
        np.testing.assert_array_equal(same[name], values[which])


def test_by_hand() -> None:
    """Two points a tile apart, and what the bytes of their first differences are."""
    points = np.array([[0.0, 0.0, 0.0], [3 * QUANTUM, 0.0, 300 * QUANTUM], [TILE * QUANTUM, 0.0, 0.0]])
    packed = pack(points, {}, VOXEL)
    assert [tile.count for tile in packed.tiles] == [2, 1]
    assert packed.tiles[1].origin == (TILE * QUANTUM, 0.0, 0.0)
    # forth by 3 is 6, by 300 is 600 = 2 * 256 + 88
    assert gzip.decompress(packed.data) == bytes([0, 6, 0, 0, 0, 0, *[0] * 6, 0, 88, 0, 0, 2, 0])
    np.testing.assert_allclose(unpack(packed)[0], points, atol=1e-12)


@pytest.mark.parametrize("reach", [1e-4, 5.0, 4_000.0])
def test_any_spread_of_points(reach: float) -> None:
    points = np.random.default_rng(9).uniform(-reach, reach, (400, 3)) * [1.0, 0.3, 0.02]
    back, _ = unpack(pack(points, {}, VOXEL))
    off, which = KDTree(points).query(back)
    assert np.abs(back - points[which]).max() <= QUANTUM / 2 + 1e-9
    assert off.max() <= QUANTUM


@pytest.mark.parametrize("count", [0, 1])
def test_few_points(count: int) -> None:
    points = np.array([[1.5, -2.5, 7.25]])[:count]
    back, columns = unpack(pack(points, {"scan": np.full(count, 3)}, VOXEL))
    np.testing.assert_allclose(back, points)
    assert columns["scan"].tolist() == [3] * count


def test_a_surface_takes_few_bytes() -> None:
    """Three a point for its place: six bits an axis within the voxel, and little for which voxel it is."""
    points = surface(60_000)
    assert len(pack(points, {}, VOXEL).data) / len(points) < 3.3


def test_the_same_points_give_the_same_bytes() -> None:
    points = surface(500)
    assert pack(points, {}, VOXEL).data == pack(points.copy(), {}, VOXEL).data


def test_codes_of_numbers_in_equal_ratios() -> None:
    """From 2 to 32, the geometric mean 8 is in the middle; what is not positive or not known has none."""
    values, (low, high) = codes(np.array([2.0, 8.0, 32.0, 0.0, np.nan, -1.0, np.inf]))
    assert values.tolist() == [1, 128, 255, 0, 0, 0, 0]
    assert (low, high) == (2.0, 32.0)
    assert codes(np.array([np.nan]))[0].tolist() == [0]
    assert codes(np.array([5.0, 5.0]))[0].tolist() == [1, 1]
