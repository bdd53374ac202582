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
    measured = clearance(wall(distance, direction), direction, 0.1)
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


def test_strays_of_all_beams_near_the_sonar_are_no_wall() -> None:
    rng = np.random.default_rng(5)
    beams = rng.normal(size=(20_000, 3)) * [0.3, 1, 0.5] + [2.0, 0, 0]
    beams /= np.linalg.norm(beams, axis=1, keepdims=True)
    ranges = np.where(
        rng.random(len(beams)) < 0.02, rng.uniform(0.2, 12, len(beams)), 12 / np.maximum(beams[:, 0], 0.2)
    )
    measured = clearance(beams * ranges[:, None], AHEAD, 0.1)
    assert measured is not None
    assert abs(measured - 12) < 0.1
