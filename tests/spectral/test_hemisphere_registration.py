"""The paper's registration: simulated pairs, bounds, and refusals."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere import HemisphereConfig, HemisphereRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.structures import occupy, surface_points, voxel_scan
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from tests.samples.refusals import refuses
from tests.samples.scenes.structures import TURN, assert_near, difference, moved, registered, structure

EDGE = 64


@pytest.fixture(scope="module")
def registrar() -> HemisphereRegistrar:
    return HemisphereRegistrar(choose_device(), Grid(EDGE, 0.4))


# One bin of 2.8 degrees and one voxel of 0.4 m.
def assert_found(registration: Registration, truth: RigidTransform, degrees: float = 2.8, meters: float = 0.4) -> None:
    assert registration.accepted, registration.reason
    assert_near(registration.T_target_source, truth, degrees, meters)


def turned(yaw: float, pitch: float, roll: float, shift: list[float]) -> RigidTransform:
    return RigidTransform.from_components(shift, Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True))


@pytest.mark.parametrize(
    ("points", "what"),
    [
        (np.zeros((50, 3)), "fill 1 of the voxels"),
        (np.column_stack([np.random.default_rng(2).uniform(-9, 9, (3000, 2)), np.zeros(3000)]), "one plane"),
        (np.random.default_rng(3).uniform(-9, 9, (3000, 1)) * [1.0, 0.5, 0.2], "one plane"),
    ],
)
def test_refuses_scans_without_structure(registrar: HemisphereRegistrar, points: np.ndarray, what: str) -> None:
    with pytest.raises(InputError, match=what):
        registrar.prepare(Scan(points.astype(np.float32)))


def test_config_refuses_what_makes_no_sense() -> None:
    refuses("`max_tilt`", HemisphereConfig, max_tilt=-1.0)
    with pytest.raises(TypeError):
        # pyrefly: ignore[unexpected-keyword]
        HemisphereConfig(peaks=3)


@pytest.mark.slow
def test_simulated_table_1() -> None:
    """The paper's S3 at sigma^2 = 1 m^2: within 6 degrees and 3 voxels."""
    from sonarmap.tools.lab.simulate.plan import table1_pair

    target, source, truth = table1_pair(3, seed=11, sigma2=1.0)
    registrar = HemisphereRegistrar(choose_device(), Grid(128, 2.0))
    assert_found(registrar.register(registrar.prepare(target), registrar.prepare(source)), truth, 6.0, 6.0)


@pytest.mark.slow
def test_strength_separates_echoes_from_clutter_and_occupancy_does_not() -> None:
    """The same structure among ten times as many weak echoes, which differ between the scans."""
    rng = np.random.default_rng(12)
    scans = []
    for points in (structure(12), moved(structure(12), TURN.inv())):
        weak = rng.uniform(points.min(axis=0), points.max(axis=0), (10 * len(points), 3)).astype(np.float32)
        strength = np.concatenate([np.ones(len(points)), np.full(len(weak), 1e-3)]).astype(np.float32)
        scans.append(Scan(np.vstack([points, weak]), strength))
    outcome = {}
    for use_strength in (False, True):
        registrar = HemisphereRegistrar(choose_device(), Grid(EDGE, 0.4), HemisphereConfig(use_strength=use_strength))
        outcome[use_strength] = registrar.register(*map(registrar.prepare, scans))
    assert_found(outcome[True], TURN)
    assert outcome[False].psr < 0.5 * outcome[True].psr


def test_max_tilt_bounds_roll_and_pitch_at_any_yaw() -> None:
    """At a yaw of 45 degrees, 20 degrees of roll and of pitch are 28 about one axis of the target."""
    T = turned(45.0, 19.0, 19.0, [0.5, -0.8, 0.4])
    config = HemisphereConfig(max_tilt=np.deg2rad(20.0))
    registrar = HemisphereRegistrar(choose_device(), Grid(EDGE, 0.4), config)
    registration = registered(registrar, structure(14), moved(structure(14), T.inv()))
    assert difference(registration.T_target_source, T)[0] < 5.6


GRID = Grid(64, 4.0)


@pytest.fixture(scope="module")
def of_the_paper() -> HemisphereRegistrar:
    return HemisphereRegistrar(choose_device(), GRID, HemisphereConfig(centered=False))


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    return surface_points(build_scene("clutter", 5).mesh, 2.0).astype(np.float64)


def register(of_the_paper: HemisphereRegistrar, points: np.ndarray, T_target_source: RigidTransform) -> RigidTransform:
    moved, still = (voxel_scan(occupy(p, GRID), GRID, "s") for p in (T_target_source.apply(points), points))
    return of_the_paper.register(of_the_paper.prepare(moved), of_the_paper.prepare(still)).T_target_source


@pytest.mark.parametrize("yaw", [-70.0])
def test_yaw_under_tilt_is_as_accurate_as_in_the_paper(of_the_paper, points, yaw):
    """Figs. 16 and 17: 10 degrees of roll and of pitch."""
    R = Rotation.from_euler("ZYX", [yaw, 10, 10], degrees=True)
    off = register(of_the_paper, points, RigidTransform.from_rotation(R)).rotation.as_euler("ZYX", degrees=True)
    assert np.abs(off - [yaw, 10, 10])[0] < 5
    assert np.abs(off - [yaw, 10, 10])[1:].max() < 3


def test_a_grid_at_the_origin_loses_points_outside(of_the_paper: HemisphereRegistrar, points: np.ndarray) -> None:
    prepared = of_the_paper.prepare(voxel_scan(occupy(points, GRID), GRID, "s"))
    assert (prepared.volume.center == 0).all()
    away = RigidTransform.from_translation([150.0, 0, 0]).apply(points).astype(np.float32)
    with pytest.raises(InputError, match="the grid of 64 voxels"):
        of_the_paper.prepare(Scan(away))


@pytest.mark.slow
def test_scans_of_different_places_are_refused(registrar: HemisphereRegistrar) -> None:
    for seed in range(4):
        registration = registered(registrar, structure(20 + seed), structure(30 + seed))
        assert not registration.accepted
        assert "wanted at least" in registration.reason


@pytest.mark.slow
def test_strength_of_points_outside_the_grid_is_ignored() -> None:
    points = np.vstack([structure(12), np.array([[900, 0, 0]], np.float32)])
    strength = np.zeros(len(points), np.float32)
    strength[-1] = 5.0
    registrar = HemisphereRegistrar(choose_device(), Grid(EDGE, 0.4), HemisphereConfig(use_strength=True))
    prepared = registrar.prepare(Scan(points, strength))
    assert registrar.register(prepared, prepared).accepted
