"""Which pairs of nearest points may move a pose: those of one side of a surface, away from rims."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from spectral.prepare.surface import Surface, smooth_surface
from spectral.verify.pairs import Pairs, find_pairs, thin

ABOVE, BESIDE, BELOW = np.array([[0.0, 0.0, 20.0], [4.0, 1.0, 20.0], [3.0, 0.0, -20.0]])


def sheet(height: float, seen_from: np.ndarray | None, shift: float = 0.0) -> Surface:
    """A level sheet of 20 by 16 voxels, a point a voxel."""
    x, y = np.meshgrid(np.arange(20.0) - 9.5 + shift, np.arange(16.0) - 7.5)
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])
    return smooth_surface(points, KDTree(points), [] if seen_from is None else [seen_from])


def pairs_of(target: Surface, source: Surface, turn: np.ndarray | None = None) -> Pairs:
    turn = np.eye(3) if turn is None else turn
    return find_pairs(
        target,
        source,
        thin(target, 1000),
        thin(source, 1000),
        turn[None],
        np.zeros((1, 3)),
        np.array([2.0]),
        stretches=False,
        inner=True,
    )


@pytest.mark.parametrize("turned", [0.0, np.pi / 2])
def test_two_sides_of_a_plate_are_not_one_surface(turned: float) -> None:
    turn = np.array([[np.cos(turned), 0, np.sin(turned)], [0, 1, 0], [-np.sin(turned), 0, np.cos(turned)]])
    front = sheet(0.5, ABOVE)

    def source(height: float, seen_from: np.ndarray | None) -> Surface:
        level = sheet(height, None)
        places = [] if seen_from is None else [turn.T @ seen_from]
        return smooth_surface(level.points @ turn, KDTree(level.points @ turn), places)

    same, other, unknown = (pairs_of(front, source(-0.5, seen_from), turn) for seen_from in (BESIDE, BELOW, None))
    assert same.inner is not None
    assert other.inner is not None
    assert same.near.all()
    assert other.near.all()
    assert same.inner.mean() > 0.5
    assert not other.inner.any()
    np.testing.assert_array_equal(unknown.inner, same.inner)


def test_beyond_a_rim_nothing_is_paired() -> None:
    """A sheet that goes on for 3 voxels more: what lies beyond the other's rim has its nearest point there."""
    pairs = pairs_of(sheet(0, ABOVE), sheet(0, ABOVE, shift=3.0))
    few = len(sheet(0, ABOVE).points)
    x = pairs.arms[0, :few, 0]
    beyond = x > 9.6
    assert pairs.inner is not None
    assert pairs.near[0, :few][beyond].any()
    assert not pairs.inner[0, :few][beyond].any()
    inside = (np.abs(x) < 6) & (np.abs(pairs.arms[0, :few, 1]) < 4)
    assert pairs.inner[0, :few][inside].all()
