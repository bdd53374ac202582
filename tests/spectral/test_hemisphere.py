"""The steps of the rotation, with the signs of docs/conventions.md, and a peak's covariance."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import Array, Device, choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.pomf.peak import Peak
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere import Match, differ, overlap, peak_covariance, peak_width, unwrap
from sonarmap.spectral.hemisphere_layers import Hemisphere
from sonarmap.spectral.prepare.prepared import Prepared, Preparer
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.translation import Translation
from tests.samples.scenes.structures import moved, structure

EDGE, VOXEL = 64, 0.4
Shift = tuple[float, float, float]


class Room:
    """A device with a structure prepared on it, and the same structure turned."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.hemisphere = Hemisphere(device, EDGE)
        self.preparer = Preparer(device, Grid(EDGE, VOXEL), use_strength=False)
        self.translation = Translation(device, EDGE)
        self.points = structure(2)
        self.target, magnitude = self.preparer.prepare(Scan(self.points))
        self.layers = self.hemisphere.prepare(magnitude)

    def turned(self, R_target_source: Rotation, shift: Shift = (0.8, -1.2, 0.6)) -> tuple[Prepared, Array]:
        """The structure as a source sees it whose R_target_source this is, and its magnitude spectrum."""
        T = RigidTransform.from_components(shift, R_target_source)
        return self.preparer.prepare(Scan(moved(self.points, T.inv())))

    def magnitude(self, R_target_source: Rotation) -> Array:
        return self.turned(R_target_source)[1]


@pytest.fixture(scope="module")
def room() -> Room:
    return Room(choose_device())


def degrees(R: Rotation) -> float:
    return float(np.rad2deg(R.magnitude()))


@pytest.mark.parametrize("yaw", [-75.0, 8.0])
def test_yaw_is_found_up_to_a_half_turn(room: Room, yaw: float) -> None:
    true = turn(yaw, 0, 0)
    one, other = room.hemisphere.yaws(room.layers, room.hemisphere.prepare(room.magnitude(true)))
    assert min(degrees(one.R.inv() * true), degrees(other.R.inv() * true)) < 3.0
    assert degrees(one.R.inv() * other.R) == pytest.approx(180.0)


def turn(*angles: float, axes: str = "ZYX") -> Rotation:
    return Rotation.from_euler(axes, angles, degrees=True)


YAW = Rotation.from_euler("Z", 40, degrees=True)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("tilt", [(0, 9), (-12, 0), (15, -7), (5, 25)])
def test_tilt_is_found_with_known_yaw(room: Room, tilt: tuple[float, float]) -> None:
    true = turn(*tilt, axes="YX") * YAW
    estimate = room.hemisphere.tilt(room.layers, room.magnitude(true), YAW, np.deg2rad(35))
    assert estimate is not None
    assert degrees(estimate.R * YAW * true.inv()) < 4.0


def test_overlap_is_the_share_in_common_and_the_smaller_of_both_directions(room: Room) -> None:
    half = room.points[room.points[:, 0] > room.target.center[0]]
    part, _ = room.preparer.prepare(Scan(half))
    shift = (part.center - room.target.center) / VOXEL
    share = len(part.surface) / len(room.target.surface)
    there = overlap(room.device, room.target, part, Rotation.identity(), shift)
    assert there == pytest.approx(share, abs=0.1)
    assert overlap(room.device, part, room.target, Rotation.identity(), -shift) == pytest.approx(there, abs=0.02)
    assert overlap(room.device, room.target, part, Rotation.identity(), shift + 500) == 0.0


@pytest.mark.parametrize("true", [(36.0, -4.0, 2.0), (12.0, -20.0, 3.0)])
def test_a_shift_over_half_the_grid_is_distinguished_from_its_wrapped_twin(room: Room, true: tuple[float, ...]) -> None:
    """Two parts of one place whose centers lie `true` voxels apart, on a grid of 64."""
    step = np.array(true) * VOXEL
    rng = np.random.default_rng(1)
    place = rng.uniform(-15, 15, (4000, 3)).astype(np.float32)
    parts = (place[np.abs(place + side * step / 2).max(axis=1) < 11] for side in (1, -1))
    target, source = (room.preparer.prepare(Scan(part))[0] for part in parts)
    shift = (source.center - target.center) / VOXEL
    cyclic = (shift + EDGE / 2) % EDGE - EDGE / 2
    unwrapped = unwrap(room.device, target, source, Rotation.identity(), cyclic, EDGE)
    np.testing.assert_allclose(unwrapped, shift, atol=1e-9)


def test_a_stray_point_outside_the_grid_changes_nothing(room: Room) -> None:
    stray = np.array([[500, 0, 0], [0, -90_000, 3]], np.float32)
    prepared, _ = room.preparer.prepare(Scan(np.vstack([room.points, stray])))
    assert overlap(room.device, room.target, prepared, Rotation.identity(), np.zeros(3)) > 0.95
    assert room.translation.find(room.target, prepared, Rotation.identity())[0].psr > 100


@pytest.mark.parametrize(
    ("voxel", "words"), [(0.1, r"holds \d+\.\d% of its points.*larger `voxel`"), (1e-40, "larger `voxel`")]
)
@pytest.mark.filterwarnings("error")
def test_a_grid_that_holds_less_than_half_of_a_scan_is_refused(voxel: float, words: str) -> None:
    preparer = Preparer(choose_device(), Grid(EDGE, voxel), use_strength=False)
    with pytest.raises(InputError, match=words):
        preparer.prepare(Scan(structure(2)))


def gaussian_peak(cov: np.ndarray) -> Peak:
    steps = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1)
    exponent = np.einsum("...i,ij,...j->...", steps, np.linalg.inv(cov), steps)
    neighborhood = np.exp(-0.5 * exponent).astype(np.float32)
    return Peak(np.zeros(3, int), np.zeros(3), 1.0, 1.0, 200.0, neighborhood, 0.0, 1.0)


def test_the_width_of_a_gaussian_peak_is_its_covariance() -> None:
    cov = np.array([[1.5, 0.3, 0.0], [0.3, 2.0, -0.2], [0.0, -0.2, 1.2]])
    np.testing.assert_allclose(peak_width(gaussian_peak(cov)), cov, rtol=1e-4, atol=1e-4)
    # a ridge is as wide as the neighborhood can tell
    ridge = gaussian_peak(np.diag([1.0, 1e6, 1.0]))
    np.testing.assert_allclose(np.diag(peak_width(ridge)), [1, 9, 1], rtol=1e-3)


def test_covariance_is_about_the_sensor_and_holds_for_the_right_tangent() -> None:
    """Against Monte Carlo: errors drawn about the grid's center, transformed to the sensor."""
    R, center, voxel, bin_angle = (Rotation.from_euler("ZYX", [0.5, -0.2, 0.1]), np.array([7.0, -3.0, 2.0]), 0.5, 0.03)
    peak = gaussian_peak(np.diag([2.0, 1.0, 1.5]))
    stated = peak_covariance(peak, R, center, Grid(128, voxel), bin_angle)
    np.testing.assert_allclose(stated, stated.T)
    rng = np.random.default_rng(5)
    count = 20_000
    turns = Rotation.from_rotvec(rng.normal(0, bin_angle / np.sqrt(12), (count, 3)))
    shifts = rng.normal(size=(count, 3)) * np.sqrt(np.array([2.0, 1.0, 1.5]) * voxel**2 / 12)
    T = RigidTransform.from_components([4.0, 5.0, 6.0], R)
    place = T.apply(center) + shifts - (R * turns).apply(np.tile(center, (count, 1)))
    xi = (T.inv() * RigidTransform.from_components(place, R * turns)).as_exp_coords()
    np.testing.assert_allclose(np.cov(xi.T), stated, atol=0.03 * np.abs(stated).max())


def test_shifts_that_differ_by_the_grid_are_the_same_answer(room: Room) -> None:
    peak = room.translation.find(room.target, room.target, Rotation.identity())[0]

    def at(shift: tuple[float, float, float], yaw: float = 0.0) -> Match:
        return Match(Rotation.from_euler("Z", yaw, degrees=True), replace(peak, shift=np.array(shift)), 1.0, 1.0)

    assert not differ(at((31.8, 0.0, 2.0)), at((-31.9, 1.0, 0.0)), EDGE)
    assert differ(at((31.8, 0.0, 2.0)), at((20.0, 0.0, 2.0)), EDGE)
    assert differ(at((0.0, 0.0, 0.0)), at((0.0, 0.0, 0.0), yaw=25.0), EDGE)


def test_tilt_keeps_to_its_limit(room: Room) -> None:
    source = room.magnitude(Rotation.from_euler("X", 30, degrees=True))
    estimate = room.hemisphere.tilt(room.layers, source, Rotation.identity(), np.deg2rad(10))
    assert estimate is None or degrees(estimate.R) < 10 * np.sqrt(2) + 3
