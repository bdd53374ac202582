"""Point-to-plane refinement: convergence to a known pose, and unconstrained directions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.spectral.covariance import by_stretch
from sonarmap.spectral.prepare.surface import Surface
from sonarmap.spectral.verify.fit import CALIBRATION, Fit
from sonarmap.spectral.verify.icp import Stage, Start, refine
from tests.spectral.surfaces import chosen_device, surface_of


def thick_corner(seed: int, noise: float) -> np.ndarray:
    """Points of three walls at right angles, `noise` voxels (rms) off them, one for each voxel that they fill."""
    rng = np.random.default_rng(seed)
    u, off = rng.uniform(-1, 1, (13_000, 6)), rng.normal(0, noise, (3, 13_000))
    floor = np.column_stack([56 * u[:, 0], 36 * u[:, 1], off[0] - 24])
    side = np.column_stack([56 + off[1], 36 * u[:, 2], 24 * u[:, 3]])
    back = np.column_stack([56 * u[:, 4], 36 + off[2], 24 * u[:, 5]])
    points = np.vstack([floor, side, back])
    return points[np.unique(np.floor(points), axis=0, return_index=True)[1]]


R_TRUE, SHIFT_TRUE = Rotation.from_euler("ZYX", [20, -6, 9], degrees=True), np.array([7.0, -3.5, 1.25])
REACHES = (4.0, 3.0, 3.0, 2.0, 2.0, 2.0, 1.5, 1.5, 1.5, 1.5)


def corner(seed: int, count: int = 4000) -> np.ndarray:
    """(3 count / 2, 3) points on three walls of different sizes, none at right angles to another [voxels]."""
    u = np.random.default_rng(seed).uniform(-1, 1, (count // 2, 6))
    floor = np.column_stack([14 * u[:, 0], 9 * u[:, 1], 0.1 * 14 * u[:, 0] - 6])
    side = np.column_stack([14 + 1.5 * u[:, 2], 9 * u[:, 3], 6 * u[:, 2]])
    back = np.column_stack([12 * u[:, 4], 9 - 0.2 * 12 * u[:, 4], 6 * u[:, 5]])
    return np.vstack([floor, side, back])


def refine_one(
    target: Surface,
    source: Surface,
    R: Rotation,
    shift: np.ndarray,
    reaches: tuple[float, ...],
    most: int,
    width: float = 0.0,
    stretches: bool = False,
) -> Fit:
    """The refinement of one pose."""
    start = Start(Rotation.concatenate([R]), shift[None], np.array([width]), stretches)
    (fit,) = refine(chosen_device(), target, source, start, [Stage(reaches, most)]).read()
    return fit


def off(fit: Fit, R: Rotation, shift: np.ndarray) -> tuple[float, float]:
    """Errors in degrees and voxels."""
    return float(np.rad2deg((fit.R * R.inv()).magnitude())), float(np.linalg.norm(fit.shift - shift))


def assert_at(fit: Fit, R: Rotation, shift: np.ndarray, degrees: float, voxels: float) -> None:
    angle, distance = off(fit, R, shift)
    assert angle < degrees
    assert distance < voxels


def lattice(x: float, y: float, height: float = 0.0, slope: float = 0.0) -> np.ndarray:
    """A point a voxel, from (-x, -y) to below (x, y)."""
    at_x, at_y = (each.ravel() for each in np.meshgrid(np.arange(-x, x), np.arange(-y, y)))
    return np.column_stack([at_x, at_y, height + slope * at_x])


@pytest.fixture(scope="module")
def pair() -> tuple[Surface, Surface]:
    """The corner as target, and other points of it as source."""
    return surface_of(corner(1)), surface_of(R_TRUE.inv().apply(corner(2) - SHIFT_TRUE))


@pytest.mark.parametrize("side", [-1, 1])
def test_a_known_pose_is_found_from_nearby(pair: tuple[Surface, Surface], side: int) -> None:
    begin = Rotation.from_rotvec(side * np.deg2rad([1.5, -2.0, 1.0])) * R_TRUE
    fit = refine_one(*pair, begin, SHIFT_TRUE + side * np.array([1.0, 0.7, -0.9]), REACHES, 3000)
    assert_at(fit, R_TRUE, SHIFT_TRUE, 0.1, 0.05)
    assert 0 < fit.residual < 0.2


def test_a_surface_in_one_scan_alone_does_not_move_the_pose(pair: tuple[Surface, Surface]) -> None:
    """A plate that stands a voxel before the floor, in the source alone."""
    u = np.random.default_rng(5).uniform(-1, 1, (400, 2))
    plate = np.column_stack([5 * u[:, 0], 4 * u[:, 1], 0.1 * 5 * u[:, 0] - 5.0])
    points = np.vstack([corner(2), plate])
    source = surface_of(R_TRUE.inv().apply(points - SHIFT_TRUE))
    assert_at(refine_one(pair[0], source, R_TRUE, SHIFT_TRUE, REACHES, 4000), R_TRUE, SHIFT_TRUE, 0.15, 0.1)


def test_a_plane_moves_along_its_normal_only() -> None:
    plane = surface_of(lattice(12, 12))
    fit = refine_one(plane, plane, Rotation.identity(), np.array([0.4, -0.3, 1.0]), REACHES, 3000)
    np.testing.assert_allclose(fit.shift, [0.4, -0.3, 0.0], atol=1e-5)
    assert fit.R.magnitude() < 1e-6
    strength = np.linalg.eigvalsh(fit.information) / np.trace(fit.information)
    assert (np.abs(strength[:3]) < 1e-9).all()
    assert strength[3] > 1e-4


def room(seed: int) -> np.ndarray:
    """The corner and an opposite wall, at the true distance or not."""
    u = np.random.default_rng(100 + seed).uniform(-1, 1, (2000, 4))
    front = np.column_stack([12 * u[:, 0], -9 + 0.1 * 12 * u[:, 0], 6 * u[:, 1]])
    other = np.column_stack([-14 + 0.5 * u[:, 2], 9 * u[:, 2], 6 * u[:, 3]])
    return np.vstack([corner(seed), front, other])


def stretch_of(fit: Fit) -> np.ndarray:
    """(2,) where it was estimated."""
    assert fit.stretch is not None
    return fit.stretch


def rigid_and_stretched(pair: tuple[Surface, Surface], R: Rotation, shift: np.ndarray) -> list[Fit]:
    return [refine_one(*pair, R, shift, REACHES, 3000, stretches=stretches) for stretches in (False, True)]


class TestStretch:
    """Ranges of the source are too long by a share; the scans are seen from different places in the room."""

    TARGET_VIEW, SOURCE_VIEW = np.array([-6.0, -4.0, 2.0]), np.array([7.0, 3.0, 0.0])
    STRETCH = 0.02

    @pytest.fixture
    def stretched(self) -> tuple[Surface, Surface]:
        seen = self.SOURCE_VIEW + (1 + self.STRETCH) * (room(2) - self.SOURCE_VIEW)
        return surface_of(room(1), [self.TARGET_VIEW]), surface_of(seen, [self.SOURCE_VIEW])

    def test_it_is_estimated_with_the_pose(self, stretched: tuple[Surface, Surface]) -> None:
        """Which of the scans is right cannot be told: each is taken to be off by half."""
        nothing = Rotation.identity(), np.zeros(3)
        rigid, estimated = rigid_and_stretched(stretched, *nothing)
        angles, distances = zip(*(off(fit, *nothing) for fit in (rigid, estimated)), strict=True)
        assert angles[1] < 0.5 * angles[0]
        assert distances[1] < distances[0]
        assert estimated.pairs > 1.3 * rigid.pairs
        assert rigid.stretch is None
        np.testing.assert_allclose(
            stretch_of(estimated), [-self.STRETCH / 2, self.STRETCH / 2], atol=0.15 * self.STRETCH
        )

    def test_scans_do_not_shrink_to_fit(self) -> None:
        """Two scans that are smaller, with the way between them, have smaller gaps; that is no reason to believe it."""
        nothing = Rotation.identity(), np.zeros(3)
        apart = self.SOURCE_VIEW - self.TARGET_VIEW
        shorter = []
        for seed in range(4):
            rng = np.random.default_rng(seed)
            rooms = [room(2 * seed + n) for n in range(2)]
            target, source = (points + 0.4 * rng.standard_normal(points.shape) for points in rooms)
            views = surface_of(target, [self.TARGET_VIEW]), surface_of(source, [self.SOURCE_VIEW])
            fit = refine_one(*views, *nothing, REACHES, 3000, stretches=True)
            shorter.append(float(fit.shift @ apart) / np.linalg.norm(apart))
            assert stretch_of(fit).sum() == pytest.approx(0, abs=1e-12)
        assert abs(np.mean(shorter)) < 0.03

    def test_scans_of_unknown_viewpoints_are_not_stretched(self, pair: tuple[Surface, Surface]) -> None:
        rigid, estimated = rigid_and_stretched(pair, R_TRUE, SHIFT_TRUE + 0.5)
        np.testing.assert_allclose(estimated.shift, rigid.shift, atol=1e-9)
        np.testing.assert_allclose(estimated.information, rigid.information, rtol=1e-9)
        np.testing.assert_array_equal(stretch_of(estimated), 0)
        # a scan of itself is not stretched
        scan = surface_of(corner(1), [self.TARGET_VIEW])
        fit = refine_one(scan, scan, Rotation.identity(), np.zeros(3), REACHES, 3000, stretches=True)
        np.testing.assert_allclose(stretch_of(fit), 0, atol=1e-9)
        np.testing.assert_allclose(fit.shift, 0, atol=1e-9)

    def test_a_common_stretch_makes_the_shift_less_certain(self, stretched: tuple[Surface, Surface]) -> None:
        """Two scans stretched alike about places apart fit at a shift that is off by a share of their distance."""
        rigid, estimated = rigid_and_stretched(stretched, Rotation.identity(), np.zeros(3))
        apart = self.SOURCE_VIEW - self.TARGET_VIEW
        left = by_stretch(estimated, np.linalg.inv(estimated.information))
        direction = np.concatenate([np.zeros(3), apart / np.linalg.norm(apart)])
        # the mean of two shares of one standard deviation each; their difference shows
        expected = (CALIBRATION.stretched * np.linalg.norm(apart)) ** 2 / 2
        assert direction @ left @ direction == pytest.approx(expected, rel=0.15)
        assert not by_stretch(rigid, np.linalg.inv(rigid.information)).any()


def test_information_does_not_depend_on_the_number_of_points_used(pair: tuple[Surface, Surface]) -> None:
    few, many = (refine_one(*pair, R_TRUE, SHIFT_TRUE, REACHES, most) for most in (500, 3000))
    assert few.pairs == pytest.approx(many.pairs, rel=0.1)
    np.testing.assert_allclose(np.diag(few.information), np.diag(many.information), rtol=0.25)


@pytest.mark.slow
def test_the_width_measures_noise_of_a_quarter_to_four_voxels() -> None:
    """The residual alone, within a fixed reach, is the same for a voxel of noise and for four."""
    widths = []
    for noise in (0.25, 0.5, 1.0, 2.0, 4.0):
        target, source = (surface_of(thick_corner(seed, noise)) for seed in (1, 2))
        rough = refine_one(target, source, Rotation.identity(), np.zeros(3), (4.0, 4.0, 3.0), 800)
        fit = refine_one(target, source, rough.R, rough.shift, (4.0, 2.0, 1.5, 1.5), 800, rough.width)
        widths.append(fit.width)
        assert np.linalg.norm(fit.shift) < 0.3 * max(noise, 0.5)
    assert (np.diff(widths) > 0.12 * np.array(widths[:-1])).all()
    assert widths[-1] > 5 * widths[0]


def test_points_that_lie_on_the_planes_count_in_full() -> None:
    """Normals are unit vectors: the trace of the shift's information is the number of points used of both scans."""
    plane = surface_of(lattice(12, 10, slope=0.2))
    fit = refine_one(plane, plane, Rotation.identity(), np.zeros(3), (2.0,), 10_000)
    assert fit.pairs == pytest.approx(2 * 24 * 20)
    assert np.trace(fit.information[3:, 3:]) == pytest.approx(fit.pairs)
    np.testing.assert_allclose(fit.information, fit.information.T)

    # turns are about the source's grid center: one about x lifts a point by y, one about y lowers it by x
    points = lattice(12, 10, 4.0)
    x, y, _ = points.T
    plane = surface_of(points)
    fit = refine_one(plane, plane, Rotation.identity(), np.zeros(3), (2.0,), 10_000)
    expected = 2 * np.array([np.sum(y**2), np.sum(x**2), 0])
    np.testing.assert_allclose(np.diag(fit.information)[:3], expected, rtol=1e-6, atol=1e-3)


def test_stages_without_a_read_equal_separate_ones(pair: tuple[Surface, Surface]) -> None:
    first, second = Stage((8.0, 5.0, 3.0), 100), Stage((3.0, 2.0, 1.5), 800)
    start = Start(Rotation.concatenate([R_TRUE]), SHIFT_TRUE[None] + 0.7, np.zeros(1))
    (together,) = refine(chosen_device(), *pair, start, [first, second]).read()
    (between,) = refine(chosen_device(), *pair, start, [first]).read()
    start = Start(Rotation.concatenate([between.R]), between.shift[None], np.array([between.width]))
    (last,) = refine(chosen_device(), *pair, start, [second]).read()
    np.testing.assert_allclose(together.shift, last.shift, atol=1e-9)
    np.testing.assert_allclose(together.R.as_matrix(), last.R.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(together.information, last.information, rtol=1e-6, atol=1e-6)
    assert together.width == pytest.approx(last.width)


def test_wide_layers_are_aligned_as_a_whole() -> None:
    """Two layers 3 voxels apart in each scan: a narrow weight would stop where one layer of each meets."""
    floor = np.column_stack([np.random.default_rng(3).uniform(-40, 40, (6000, 2)), np.zeros(6000)])
    layers = np.vstack([floor[:3000], floor[3000:] + np.array([0, 0, 3.0])])
    target, source = surface_of(layers), surface_of(layers[::-1] * np.array([1, -1, 1.0]))
    narrow = refine_one(target, source, Rotation.identity(), np.array([0, 0, 2.6]), (1.5,) * 10, 3000)
    wide = refine_one(target, source, Rotation.identity(), np.array([0, 0, 2.6]), (1.5,) * 10, 3000, width=2.0)
    assert narrow.shift[2] > 2.5
    assert abs(wide.shift[2]) < narrow.shift[2] - 0.5
