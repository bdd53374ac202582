"""Points near a place are found by tiles as they are by looking at all."""

import numpy as np
import pytest

from sonarmap.slam.map.tiles import Tiles


@pytest.mark.parametrize("size", [0.7, 3.0, 50.0])
def test_it_finds_the_points_that_all_distances_find(size: float) -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(2000, 3)) * [20, 5, 1] + [1e6, -3e5, 40]
    tiles = Tiles.of(points, size)
    for _ in range(20):
        center, radius = points[rng.integers(2000)] + rng.normal(size=3), float(rng.uniform(0.1, 9))
        wanted = np.flatnonzero(((points - center) ** 2).sum(axis=1) < radius**2)
        np.testing.assert_array_equal(tiles.within(center, radius), wanted)
    assert not len(tiles.within(points[0] + 1e5, 5.0))


def test_a_point_far_away_is_in_no_tile() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1e9, 0, 0]])
    assert Tiles.of(points, 1.0).within(np.zeros(3), 2.0).tolist() == [0, 1]
