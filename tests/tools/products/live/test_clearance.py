"""The distance to the nearest surface in a direction."""

import numpy as np
import pytest

from sonarmap.tools.products.live.clearance import clearance

DOWN, AHEAD = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])


def wall(distance: float, normal: np.ndarray, noise: float = 0.03) -> np.ndarray:
    """Points (N, 3) of a wall across a direction [m]."""
    rng = np.random.default_rng(3)
    points = rng.uniform(-6, 6, (4000, 3))
    return points + np.outer(distance + rng.normal(0, noise, len(points)) - points @ normal, normal)


@pytest.mark.parametrize("distance", [0.7, 4.0, 25.0])
@pytest.mark.parametrize("direction", [DOWN, AHEAD, np.array([0.6, 0.8, 0.0])])
def test_a_wall_is_as_far_as_it_stands(distance: float, direction: np.ndarray) -> None:
    behind = wall(distance + 3, direction)
    measured = clearance(np.concatenate([behind, wall(distance, direction)]), direction, 0.1)
    assert measured is not None
    assert abs(measured - distance) < 0.1


def test_stray_echoes_and_what_lies_aside_or_behind_are_no_wall() -> None:
    strays = np.array([[2.0, 0.1, 0.0], [4.0, 0.0, 0.2], [6.0, 0.0, 0.0]])
    bed = wall(1.5, DOWN)
    assert clearance(np.concatenate([strays, bed, wall(-2.0, AHEAD)]), AHEAD, 0.1) is None
    assert clearance(np.zeros((0, 3)), AHEAD, 0.1) is None
    measured = clearance(np.concatenate([strays, bed, wall(9.0, AHEAD)]), AHEAD, 0.1)
    assert measured is not None
    assert abs(measured - 9) < 0.1
