"""Correlation of heights over beds: against plain sums, in turned axes, and with lines of beams."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.spectral.prepare.surface import Surface
from sonarmap.spectral.verify.relief import Heights, alike_places, is_level
from tests.spectral.surfaces import surface_of

CELL = 4.0
TILT = Rotation.from_euler("ZYX", [0.7, -0.3, 0.2])


def bed(places: np.ndarray) -> np.ndarray:
    """(n, 3) points of one bed without a period, at places (n, 2)."""
    x, y = places.T
    return np.column_stack([places, np.sin(x / 9) + np.cos(y / 7 + x / 31) + np.sin((x * x + y * y) / 900)])


def seen(rng: np.random.Generator, about: tuple[float, float], count: int = 3000) -> np.ndarray:
    """(n, 3) points of the bed, 30 voxels and less from a place along both axes."""
    return bed(np.add(about, rng.uniform(-30, 30, (count, 2))))


def above(points: np.ndarray, axes: Rotation, seen_from: tuple[float, float, float] | None = (0, 0, 40)) -> Surface:
    """The surface of points in turned axes, seen from a viewpoint in their original axes."""
    return surface_of(axes.apply(points), [] if seen_from is None else [axes.apply(seen_from)])


def any_rotation(R: Rotation) -> np.ndarray:
    return np.ones(len(R), bool)


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("seen_from", [(0, 0, 40), None])
@pytest.mark.parametrize(("yaw", "moved"), [(0.0, (8, -4, 1.5)), (1.7, (-20, 12, 0)), (4.4, (0, 24, -3))])
def test_the_true_turn_and_shift_are_the_best_in_any_axes(
    yaw: float, moved: tuple[float, float, float], seen_from: tuple[float, float, float] | None
) -> None:
    """A twentieth of the points are strays, which must not change the heights."""
    rng = np.random.default_rng(3)
    R = TILT * Rotation.from_euler("z", yaw)
    target, source = seen(rng, (0, 0)), seen(rng, (10, -6))
    for points in (target, source):
        points[::20, 2] += rng.uniform(20, 60, len(points[::20]))
    # the source is seen after a turn about the vertical and a shift
    theirs = Rotation.from_euler("z", -yaw).apply(source - moved)
    named = alike_places(above(target, TILT), above(theirs, TILT, seen_from), any_rotation, 5)
    assert len(named.shifts) <= 5
    assert (np.diff(named.alike) <= 0).all()
    assert (named.R[0] * (R * TILT.inv()).inv()).magnitude() < np.deg2rad(6)
    middle = theirs.mean(axis=0)  # where an error of the turn moves least
    off = named.R[0].apply(TILT.apply(middle)) + named.shifts[0] - TILT.apply(source.mean(axis=0))
    np.testing.assert_allclose(TILT.inv().apply(off), 0, atol=1.25 * CELL)
    assert TILT.inv().apply(off)[2] == pytest.approx(0, abs=0.7)


def test_only_allowed_rotations_are_found_by_height() -> None:
    rng = np.random.default_rng(6)
    ours, theirs = above(seen(rng, (0, 0)), TILT), above(seen(rng, (5, 5)), TILT)
    far = alike_places(ours, theirs, lambda R: R.magnitude() > 1.0, 4)
    assert len(far.shifts)
    assert (far.R.magnitude() > 1.0).all()
    none = alike_places(ours, theirs, lambda R: np.zeros(len(R), bool), 4)
    assert none.shifts.shape == (0, 3)
    assert none.alike.shape == (0,)
    assert len(none.R) == 0


def test_a_flat_bed_and_few_points_give_no_places() -> None:
    rng = np.random.default_rng(5)
    flat = above(np.column_stack([rng.uniform(-30, 30, (500, 2)), np.zeros(500)]), TILT)
    few = above(np.array([[0.0, 0, 0], [3, 0, 0], [0, 5, 0]]), TILT)
    for target, source in ((flat, flat), (flat, few), (few, flat), (few, few)):
        assert len(alike_places(target, source, any_rotation, 4).shifts) == 0


def test_a_bed_is_level_in_any_axes_and_a_corner_is_not() -> None:
    points = seen(np.random.default_rng(7), (0, 0))
    assert is_level(above(points, TILT))
    wall = np.column_stack([points[:, 2], points[:, :2]])
    assert not is_level(above(np.vstack([points, wall]), TILT))


def test_similarity_is_computed_over_the_cells_in_common() -> None:
    """Against plain sums, to 1e-4, over the cells in common at each shift."""
    rng = np.random.default_rng(4)
    target, source = seen(rng, (0, 0), 300), seen(rng, (6, 9), 250) - (8, -12, 0)

    def cells(points: np.ndarray) -> dict[tuple[int, int], float]:
        keys = [tuple(key) for key in np.floor(points[:, :2] / CELL).astype(int).tolist()]
        return {key: float(np.mean([z for k, z in zip(keys, points[:, 2], strict=True) if k == key])) for key in keys}

    def heights(points: np.ndarray) -> Heights:
        return Heights.of(points[None], points[:, :2].min(axis=0), points[:, :2].max(axis=0))

    places = heights(target).alike(heights(source), 9)[:, 1:]
    ours, theirs = cells(target), cells(source)
    assert len(places) > 3
    for x, y, higher, value in places[:3].tolist():
        both = [(ours[i + x, j + y], z) for (i, j), z in theirs.items() if (i + x, j + y) in ours]
        correlation = np.corrcoef(np.array(both).T)[0, 1]
        assert value == pytest.approx(np.arctanh(correlation) * np.sqrt(len(both)), rel=1e-4)
        assert higher == pytest.approx(np.mean([a - b for a, b in both]), abs=1e-5)


def test_beam_lines_do_not_favor_the_identity() -> None:
    """Both scans have lines 5 voxels apart, fixed to the sensor, which has moved by 13 voxels."""
    along, across = np.meshgrid(np.arange(-30.0, 30.0), np.arange(-30.0, 30.0, 5.0))
    lines = np.column_stack([along.ravel(), across.ravel()])
    moved = np.array([5.0, 12.0, 0.0])
    still = Rotation.identity()
    named = alike_places(
        above(bed(lines), still), above(bed(lines + moved[:2]) - moved, still), lambda R: R.magnitude() < 0.1, 1
    )
    np.testing.assert_allclose(named.shifts[0], moved, atol=CELL)
