"""Heights over a plane, compared at every shift: beside sums by hand, in turned axes, and where beams draw lines."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.spectral.verify.relief import alike_places

CELL = 4.0
TURN = Rotation.from_euler("ZYX", [0.7, -0.4, 0.3])
LEVEL = np.eye(3)[:, :2]


def bed(places: np.ndarray) -> np.ndarray:
    """(n, 3) points of one bed without a period, at places (n, 2)."""
    x, y = places.T
    return np.column_stack([places, np.sin(x / 9) + np.cos(y / 7 + x / 31) + np.sin((x * x + y * y) / 900)])


def seen(rng: np.random.Generator, about: tuple[float, float], count: int = 3000) -> np.ndarray:
    """(n, 3) points of the bed, 30 voxels and less from a place along both axes."""
    return bed(np.add(about, rng.uniform(-30, 30, (count, 2))))


@pytest.mark.parametrize("moved", [(8.0, -4.0, 1.5), (-20.0, 12.0, 0.0), (0.0, 24.0, -3.0)])
def test_the_true_shift_is_named_first_in_any_axes(moved: tuple[float, float, float]) -> None:
    """A twentieth of the points are strays, which no height of the bed is told by."""
    rng = np.random.default_rng(3)
    target, source = seen(rng, (0, 0)), seen(rng, (10, -6)) - moved
    for points in (target, source):
        points[::20, 2] += rng.uniform(-60, 60, len(points[::20]))
    places, alike = alike_places(TURN.apply(target), TURN.apply(source), TURN.as_matrix()[:, :2], 4)
    np.testing.assert_allclose(TURN.inv().apply(places[0])[:2], moved[:2], atol=CELL)
    assert TURN.inv().apply(places[0])[2] == pytest.approx(moved[2], abs=0.3)
    assert alike[0] > 0.9
    assert (np.diff(alike) <= 0).all()
    assert len(places) <= 4


def test_how_alike_heights_are_is_the_correlation_of_the_cells_in_common() -> None:
    """Summed by hand, to 1e-6, over all cells that both show at the shift."""
    rng = np.random.default_rng(4)
    target, source = seen(rng, (0, 0), 300), seen(rng, (6, 9), 250) - (8, -12, 0)

    def cells(points: np.ndarray) -> dict[tuple[int, int], float]:
        keys = [tuple(key) for key in np.floor(points[:, :2] / CELL).astype(int).tolist()]
        return {key: float(np.mean([z for k, z in zip(keys, points[:, 2], strict=True) if k == key])) for key in keys}

    places, alike = alike_places(target, source, LEVEL, 3)
    ours, theirs = cells(target), cells(source)
    for place, value in zip(places, alike, strict=True):
        x, y = np.rint(place[:2] / CELL).astype(int).tolist()
        both = [(ours[i + x, j + y], z) for (i, j), z in theirs.items() if (i + x, j + y) in ours]
        assert value == pytest.approx(np.corrcoef(np.array(both).T)[0, 1], abs=1e-6)
        assert place[2] == pytest.approx(np.mean([a - b for a, b in both]), abs=1e-6)


def test_lines_that_beams_draw_do_not_hold_a_scan_where_it_has_not_moved() -> None:
    """Both scans show lines 5 voxels apart, at the same places of the sensor, which has moved by 13 voxels."""
    along, across = np.meshgrid(np.arange(-30, 30, 0.5), np.arange(-30, 30, 5.0))
    lines = np.column_stack([along.ravel(), across.ravel()])
    moved = np.array([5.0, 12.0, 0.0])
    places, _ = alike_places(bed(lines), bed(lines + moved[:2]) - moved, LEVEL, 1)
    np.testing.assert_allclose(places[0], moved, atol=CELL)


def test_a_flat_bed_and_no_points_name_nothing() -> None:
    rng = np.random.default_rng(5)
    flat = np.column_stack([rng.uniform(-30, 30, (500, 2)), np.zeros(500)])
    for target, source in ((flat, flat), (flat, flat[:0]), (flat[:0], flat)):
        places, alike = alike_places(target, source, LEVEL, 4)
        assert places.shape == (0, 3)
        assert alike.shape == (0,)
