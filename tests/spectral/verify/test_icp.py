"""Point-to-plane refinement: a known pose found again from nearby, and what no surface fixes left alone."""

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from spectral.prepare.surface import Surface, smooth_surface
from spectral.verify.icp import Fit, refine

R_TRUE, SHIFT_TRUE = Rotation.from_euler("ZYX", [20, -6, 9], degrees=True), np.array([7.0, -3.5, 1.25])
REACHES = (4.0, 3.0, 3.0, 2.0, 2.0, 2.0, 1.5, 1.5, 1.5, 1.5)


def corner(seed: int, count: int = 4000) -> np.ndarray:
    """(3 count / 2, 3) points on three walls of different sizes, none at right angles to another [voxels]."""
    u = np.random.default_rng(seed).uniform(-1, 1, (count // 2, 6))
    floor = np.column_stack([14 * u[:, 0], 9 * u[:, 1], 0.1 * 14 * u[:, 0] - 6])
    side = np.column_stack([14 + 1.5 * u[:, 2], 9 * u[:, 3], 6 * u[:, 2]])
    back = np.column_stack([12 * u[:, 4], 9 - 0.2 * 12 * u[:, 4], 6 * u[:, 5]])
    return np.vstack([floor, side, back])


def surface(points: np.ndarray) -> Surface:
    return smooth_surface(points, KDTree(points))


def off(fit: Fit, R: Rotation, shift: np.ndarray) -> tuple[float, float]:
    """Degrees and voxels."""
    return float(np.rad2deg((fit.R * R.inv()).magnitude())), float(np.linalg.norm(fit.shift - shift))


@pytest.fixture(scope="module")
def pair() -> tuple[Surface, Surface]:
    """The corner, and other points of it as a source sees them."""
    return surface(corner(1)), surface(R_TRUE.inv().apply(corner(2) - SHIFT_TRUE))


@pytest.mark.parametrize("side", [-1, 1])
def test_a_known_pose_is_found_from_nearby(pair: tuple[Surface, Surface], side: int) -> None:
    begin = Rotation.from_rotvec(side * np.deg2rad([1.5, -2.0, 1.0])) * R_TRUE
    fit = refine(*pair, begin, SHIFT_TRUE + side * np.array([1.0, 0.7, -0.9]), REACHES, 3000)
    angle, distance = off(fit, R_TRUE, SHIFT_TRUE)
    assert angle < 0.1
    assert distance < 0.05
    assert 0 < fit.residual < 0.2


def test_the_other_way_round_is_the_inverse(pair: tuple[Surface, Surface]) -> None:
    target, source = pair
    there = refine(target, source, R_TRUE, SHIFT_TRUE + 0.5, REACHES, 3000)
    back = refine(source, target, R_TRUE.inv(), -R_TRUE.inv().apply(SHIFT_TRUE) - 0.3, REACHES, 3000)
    angle, distance = off(back, there.R.inv(), -there.R.inv().apply(there.shift))
    assert angle < 0.02
    assert distance < 0.02


def test_what_only_one_scan_shows_does_not_draw_it(pair: tuple[Surface, Surface]) -> None:
    """A plate that stands a voxel before the floor, in the source alone."""
    u = np.random.default_rng(5).uniform(-1, 1, (400, 2))
    plate = np.column_stack([5 * u[:, 0], 4 * u[:, 1], 0.1 * 5 * u[:, 0] - 5.0])
    points = np.vstack([corner(2), plate])
    source = surface(R_TRUE.inv().apply(points - SHIFT_TRUE))
    angle, distance = off(refine(pair[0], source, R_TRUE, SHIFT_TRUE, REACHES, 4000), R_TRUE, SHIFT_TRUE)
    assert angle < 0.15
    assert distance < 0.1


def test_a_plane_alone_moves_along_its_normal_and_not_otherwise() -> None:
    x, y = np.meshgrid(np.arange(-12.0, 12.0), np.arange(-12.0, 12.0))
    plane = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    fit = refine(surface(plane), surface(plane), Rotation.identity(), np.array([0.4, -0.3, 1.0]), REACHES, 3000)
    np.testing.assert_allclose(fit.shift, [0.4, -0.3, 0.0], atol=1e-5)
    assert fit.R.magnitude() < 1e-6
    strength = np.linalg.eigvalsh(fit.information) / np.trace(fit.information)
    assert (np.abs(strength[:3]) < 1e-9).all()
    assert strength[3] > 1e-4


def test_points_that_lie_on_the_planes_count_in_full() -> None:
    """Normals are unit vectors: the information about the shift sums to the points that took part, of both scans."""
    x, y = np.meshgrid(np.arange(-12.0, 12.0), np.arange(-10.0, 10.0))
    plane = surface(np.column_stack([x.ravel(), y.ravel(), 0.2 * x.ravel()]))
    fit = refine(plane, plane, Rotation.identity(), np.zeros(3), (2.0,), 10_000)
    assert fit.pairs == pytest.approx(2 * 24 * 20)
    assert np.trace(fit.information[3:, 3:]) == pytest.approx(fit.pairs)
    np.testing.assert_allclose(fit.information, fit.information.T)


def test_turns_are_about_the_sources_grid_center() -> None:
    """About an axis through it along a wall's normal, points far out have the longest arms: sum of the squares."""
    x, y = np.meshgrid(np.arange(-12.0, 13.0), np.arange(-10.0, 11.0))
    plane = surface(np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 4.0)]))
    fit = refine(plane, plane, Rotation.identity(), np.zeros(3), (2.0,), 10_000)
    # a turn about x lifts a point by y, one about y lowers it by x
    expected = 2 * np.array([np.sum(y**2), np.sum(x**2), 0])
    np.testing.assert_allclose(np.diag(fit.information)[:3], expected, rtol=1e-6, atol=1e-3)


def test_nothing_within_reach_moves_nothing(pair: tuple[Surface, Surface]) -> None:
    shift = np.array([500.0, -20, 3])
    fit = refine(*pair, R_TRUE, shift, REACHES, 1000)
    assert fit.pairs == 0
    assert off(fit, R_TRUE, shift) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert np.isfinite(fit.information).all()
    assert fit.residual == 0


def test_twice_is_the_same(pair: tuple[Surface, Surface]) -> None:
    first, second = (refine(*pair, R_TRUE, SHIFT_TRUE + 0.5, REACHES, 500) for _ in range(2))
    np.testing.assert_array_equal(first.information, second.information)
    np.testing.assert_array_equal(first.shift, second.shift)


def thick_corner(seed: int, noise: float) -> np.ndarray:
    """Points of three walls at right angles, `noise` voxels (rms) off them, one for each voxel that they fill."""
    rng = np.random.default_rng(seed)
    u, off = rng.uniform(-1, 1, (13_000, 6)), rng.normal(0, noise, (3, 13_000))
    floor = np.column_stack([56 * u[:, 0], 36 * u[:, 1], off[0] - 24])
    side = np.column_stack([56 + off[1], 36 * u[:, 2], 24 * u[:, 3]])
    back = np.column_stack([56 * u[:, 4], 36 + off[2], 24 * u[:, 5]])
    points = np.vstack([floor, side, back])
    return points[np.unique(np.floor(points), axis=0, return_index=True)[1]]


def test_noise_of_a_quarter_to_four_voxels_tells_itself_apart() -> None:
    """The residual alone, within a fixed reach, is the same for a voxel of noise and for four."""
    widths = []
    for noise in (0.25, 0.5, 1.0, 2.0, 4.0):
        target, source = (surface(thick_corner(seed, noise)) for seed in (1, 2))
        rough = refine(target, source, Rotation.identity(), np.zeros(3), (4.0, 4.0, 3.0), 800)
        fit = refine(target, source, rough.R, rough.shift, (4.0, 2.0, 1.5, 1.5), 800, rough.width)
        widths.append(fit.width)
        assert np.linalg.norm(fit.shift) < 0.3 * max(noise, 0.5)
    assert (np.diff(widths) > 0.12 * np.array(widths[:-1])).all()
    assert widths[-1] > 5 * widths[0]


def test_wide_scans_are_brought_together_as_a_whole() -> None:
    """Two layers 3 voxels apart on either side: a narrow bell would stop where one layer of each meets."""
    floor = np.column_stack([np.random.default_rng(3).uniform(-40, 40, (6000, 2)), np.zeros(6000)])
    layers = np.vstack([floor[:3000], floor[3000:] + np.array([0, 0, 3.0])])
    target, source = surface(layers), surface(layers[::-1] * np.array([1, -1, 1.0]))
    narrow = refine(target, source, Rotation.identity(), np.array([0, 0, 2.6]), (1.5,) * 10, 3000)
    wide = refine(target, source, Rotation.identity(), np.array([0, 0, 2.6]), (1.5,) * 10, 3000, width=2.0)
    assert narrow.shift[2] > 2.5
    assert abs(wide.shift[2]) < narrow.shift[2] - 0.5


def test_information_does_not_depend_on_how_many_points_took_part(pair: tuple[Surface, Surface]) -> None:
    few, many = (refine(*pair, R_TRUE, SHIFT_TRUE, REACHES, most) for most in (500, 3000))
    assert few.pairs == pytest.approx(many.pairs, rel=0.1)
    np.testing.assert_allclose(np.diag(few.information), np.diag(many.information), rtol=0.25)
