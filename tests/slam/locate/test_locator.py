"""Scans located in a map: of this place, of another, of two that look the same; alone and in a row."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.slam.locate.locator import Locator
from sonarmap.slam.locate.place import Located
from sonarmap.slam.locate.surveyed_map import LEAST, SurveyedMap, View
from sonarmap.spectral.grid import choose_grid
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.clutter_scans import T_WORLD_SENSOR, clutter, plane

VOXEL, NOISE = 0.4, 0.03
COVARIANCE = np.diag(np.repeat([1e-3, 1e-2], 3) ** 2)
MOVED = RigidTransform.from_components([300.0, -80.0, 7.0], Rotation.from_euler("ZYX", [2.1, 0.2, -0.1]))
AWAY = RigidTransform.from_translation([60.0, 0, 0])
ROW = RigidTransform.from_components(
    np.stack([np.linspace(-3, 3, 9), np.linspace(-1, 1.5, 9) ** 2 / 2, np.zeros(9)], axis=1),
    Rotation.from_euler("z", np.linspace(-0.2, 0.4, 9)[:, None]),
)


def map_of(points: np.ndarray, T: RigidTransform, measured: bool = False) -> SurveyedMap:
    """A map whose points belong to the scans in turn."""
    seen_by = np.arange(len(points)) % len(T)
    return SurveyedMap(points, seen_by, T, np.tile(COVARIANCE, (len(T), 1, 1)), VOXEL, np.full(6, measured))


def locator(surveyed: SurveyedMap) -> Locator:
    return Locator(SpectralRegistrar(choose_device(), choose_grid(surveyed.key_scans(), 64)), surveyed)


def scan_at(T: RigidTransform, scene: int = 1, stamp: float = 0.0) -> Scan:
    points = clutter(scene).astype(np.float64) + np.random.default_rng(7).normal(0, NOISE, (7200, 3))
    return Scan(T.inv().apply(points).astype(np.float32), stamp=stamp, name=f"at{stamp:g}")


@pytest.fixture(scope="module")
def surveyed() -> SurveyedMap:
    return map_of(clutter().astype(np.float64), T_WORLD_SENSOR[:3])


@pytest.fixture(scope="module")
def located(surveyed: SurveyedMap) -> Located:
    return locator(surveyed).locate(scan_at(T_WORLD_SENSOR[3]))


def check_at(located: Located, T_true: RigidTransform) -> None:
    assert located.located, located
    error = T_true.inv() * located.T_map_scan
    assert np.linalg.norm(error.translation) < VOXEL
    assert error.rotation.magnitude() < np.radians(2)


def test_a_scan_is_located_with_a_covariance(located: Located) -> None:
    check_at(located, T_WORLD_SENSOR[3])
    assert located.probability > 0.9
    assert np.linalg.eigvalsh(located.covariance - COVARIANCE).min() > -1e-4  # includes the map's own
    assert 0 < located.overlap <= 1
    assert located.psr > 10
    assert located.seconds > 0


@pytest.mark.slow
def test_the_answer_moves_with_the_map(surveyed: SurveyedMap, located: Located) -> None:
    moved = map_of(MOVED.apply(surveyed.points), MOVED * surveyed.T_map_sensor)
    again = locator(moved).locate(scan_at(T_WORLD_SENSOR[3]))
    apart = (MOVED * located.T_map_scan).inv() * again.T_map_scan
    assert np.linalg.norm(apart.translation) < 0.05 * VOXEL
    assert apart.rotation.magnitude() < np.radians(0.1)
    assert again.probability == pytest.approx(located.probability, abs=0.01)
    np.testing.assert_allclose(np.diag(again.covariance), np.diag(located.covariance), rtol=0.2)


def test_a_scan_of_another_place_is_not_located(surveyed: SurveyedMap) -> None:
    other = locator(surveyed).locate(scan_at(T_WORLD_SENSOR[3], scene=2))
    assert not other.located
    assert other.probability < 0.5
    assert other.reason


def test_a_scan_that_shows_nothing_is_not_located(surveyed: SurveyedMap) -> None:
    flat = locator(surveyed).locate(Scan(plane(), name="flat"))
    assert not flat.located
    assert flat.place is None
    assert "plane" in flat.reason
    assert np.isinf(flat.covariance.diagonal()).all()


def twins(measured: bool) -> SurveyedMap:
    """The same clutter twice, 60 m apart."""
    points = clutter().astype(np.float64)
    T = RigidTransform.concatenate([T_WORLD_SENSOR[:2], AWAY * T_WORLD_SENSOR[:2]])
    both = np.stack([points[:3600], points[3600:], AWAY.apply(points[:3600]), AWAY.apply(points[3600:])], axis=1)
    return map_of(both.reshape(-1, 3), T, measured)


def test_of_two_places_that_look_the_same_none_is_accepted() -> None:
    located = locator(twins(measured=False)).locate(scan_at(T_WORLD_SENSOR[3]))
    assert not located.located
    assert located.probability <= 0.5
    assert located.alternatives[0].probability > 0.2
    shift = np.linalg.norm(located.alternatives[0].T_map_scan.translation - located.T_map_scan.translation)
    assert shift == pytest.approx(60, abs=1)


@pytest.mark.slow
def test_a_prior_chooses_between_places_that_look_the_same() -> None:
    T = AWAY * T_WORLD_SENSOR[3]
    prior = PosePrior(T, np.array([0.02, 0.02, 0.05, 2.0, 2.0, 1.0]))
    check_at(locator(twins(measured=True)).locate(replace(scan_at(T_WORLD_SENSOR[3]), prior=prior)), T)


@pytest.mark.slow
def test_consecutive_scans_are_tracked_by_their_motion(surveyed: SurveyedMap) -> None:
    scans = [scan_at(T, stamp=float(k)) for k, T in enumerate(ROW)]
    tracked = list(locator(surveyed).track(scans, [0] * len(scans)))
    for each, T in zip(tracked, ROW, strict=True):
        check_at(each, T)
    assert [each.tracked for each in tracked] == [False] * 5 + [True] * 4
    assert [each.stamp for each in tracked] == [float(k) for k in range(9)]
    # after a scan of another survey or of another place, the whole map is searched
    scans[6] = scan_at(ROW[6], scene=2, stamp=6.0)
    lost = list(locator(surveyed).track(scans, [0] * 5 + [1] * 4))
    assert [each.located for each in lost] == [True] * 6 + [False] + [True] * 2
    assert not any(each.tracked for each in lost)


def test_a_map_with_too_few_points_is_refused() -> None:
    few = map_of(clutter()[:90].astype(np.float64), T_WORLD_SENSOR[:3])
    with pytest.raises(InputError, match="50 points of its own"):
        few.key_scans()


def test_errors_of_a_prior_from_the_map_turn_with_the_heading() -> None:
    """As in every prior, an error about the sensor's forward axis is one of roll at any heading."""
    sigmas = np.array([0.01, 0.1, 0.05, 0.2, 1.0, 0.5])
    at = RigidTransform.from_rotation(Rotation.from_euler("Z", [[90.0]], degrees=True))
    surveyed = SurveyedMap(np.zeros((1, 3)), np.zeros(1, int), at, np.diag(sigmas**2)[None], VOXEL, np.full(6, True))
    prior = surveyed.prior_at(at[0])
    assert prior is not None
    np.testing.assert_allclose(prior.sigmas, np.hypot(sigmas[[0, 1, 2, 4, 3, 5]], LEAST), rtol=1e-6)


def test_a_view_holds_most_points_of_a_scan(surveyed: SurveyedMap) -> None:
    points = scan_at(T_WORLD_SENSOR[0]).points + np.array([15, 0, 0], np.float32)
    view = View.of(points)
    assert view.reach == pytest.approx(np.quantile(np.linalg.norm(points, axis=1), 0.95))
    ahead = T_WORLD_SENSOR[0] * RigidTransform.from_translation([-15.0, 0, 0])
    seen = surveyed.seen_from(ahead, view)
    assert 0.85 * len(points) < len(seen) < len(points)
