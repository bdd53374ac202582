"""Which pairs of nearest points may move a pose: those of one side of a surface, away from rims."""

import numpy as np
import pytest

from sonarmap.kernels.surface.refinement import Refinement, Weighting
from sonarmap.spectral.prepare.surface import Surface
from tests.spectral.surfaces import chosen_device, surface_of

# So wide a bell that each pair within reach weighs 1.
EVEN = Weighting(bell=1e6, wide_bell=0.0, bells=0.0, measured=3.0)
ABOVE, BESIDE, BELOW = np.array([[0.0, 0.0, 20.0], [4.0, 1.0, 20.0], [3.0, 0.0, -20.0]])


def sheet(height: float, seen_from: np.ndarray | None, shift: float = 0.0) -> Surface:
    """A level sheet of 20 by 16 voxels, a point a voxel."""
    x, y = np.meshgrid(np.arange(20.0) - 9.5 + shift, np.arange(16.0) - 7.5)
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])
    return surface_of(points, [] if seen_from is None else [seen_from])


def shares(target: Surface, source: Surface, turn: np.ndarray | None = None) -> tuple[float, float]:
    """Of all points of both: those that have a pair, and whose pair moves the pose."""
    steps = Refinement(chosen_device(), target.elements, source.elements, 1000, EVEN, None)
    steps.begin((np.eye(3) if turn is None else turn)[None], np.zeros((1, 3)), np.zeros(1), None)
    steps.step(2.0, alone=False)
    record = steps.end().read()
    count = len(target.elements) + len(source.elements)
    # normals are unit vectors: each pair adds its weight to the trace
    whole, moving = (float(np.trace(sums[0, 3:6, 3:6])) / count for sums in (record.whole, record.moving))
    return whole, moving


@pytest.mark.parametrize("turned", [0.0, np.pi / 2])
def test_two_sides_of_a_plate_are_not_one_surface(turned: float) -> None:
    turn = np.array([[np.cos(turned), 0, np.sin(turned)], [0, 1, 0], [-np.sin(turned), 0, np.cos(turned)]])
    front = sheet(0.5, ABOVE)

    def source(height: float, seen_from: np.ndarray | None) -> Surface:
        level = sheet(height, None)
        return surface_of(level.points @ turn, [] if seen_from is None else [turn.T @ seen_from])

    same, other, unknown = (shares(front, source(-0.5, seen_from), turn) for seen_from in (BESIDE, BELOW, None))
    assert same[0] == pytest.approx(1, abs=1e-5)
    assert other[0] == pytest.approx(1, abs=1e-5)
    assert same[1] > 0.5
    assert other[1] == 0
    assert unknown[1] == pytest.approx(same[1])


def test_beyond_a_rim_nothing_is_paired() -> None:
    """A sheet that goes on for 3 voxels more: what lies beyond the other's rim has its nearest point there."""
    paired, moving = shares(sheet(0, ABOVE), sheet(0, ABOVE, shift=3.0))
    # of 20 columns of points 17 lie above the other sheet, and another is within reach
    assert paired >= 18 / 20 - 1e-5
    assert 0.4 < moving < 17 / 20
