"""The chain over the hemisphere and the paper's own: laws that any registration obeys, and simulated pairs."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.hemisphere.registration import HemisphereConfig, HemisphereRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.shapes.structure import occupy, surface_points, voxel_scan
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


def test_a_scan_registers_to_itself(registrar: HemisphereRegistrar) -> None:
    points = structure(1)
    registration = registered(registrar, points, points)
    assert_found(registration, RigidTransform.identity(), 0.05, 0.01)
    assert registration.overlap == 1.0


def turned(yaw: float, pitch: float, roll: float, shift: list[float]) -> RigidTransform:
    return RigidTransform.from_components(shift, Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True))


FOUND = [(4, turned(yaw, 3, -5, [0.8, 1.1, -0.5])) for yaw in (-170, -95, 100, 180)]


@pytest.mark.parametrize(("seed", "T"), [(1, TURN), (2, TURN), (3, TURN), *FOUND])
def test_finds_a_known_transform_whatever_the_yaw(registrar: HemisphereRegistrar, seed: int, T: RigidTransform) -> None:
    points = structure(seed)
    assert_found(registered(registrar, points, moved(points, T.inv())), T)


def test_the_other_way_round_is_the_inverse(registrar: HemisphereRegistrar) -> None:
    target, source = structure(5), moved(structure(5), TURN.inv())
    there, back = registered(registrar, target, source), registered(registrar, source, target)
    assert_found(back, there.T_target_source.inv())


def test_moving_the_source_moves_the_answer(registrar: HemisphereRegistrar) -> None:
    points = structure(6)
    X = RigidTransform.from_components([30.0, -12.0, 5.0], Rotation.from_euler("Z", 11, degrees=True))
    plain = registered(registrar, points, moved(points, TURN.inv()))
    other = registered(registrar, points, moved(points, X * TURN.inv()))
    assert_found(other, plain.T_target_source * X.inv())


def test_two_steps_make_one(registrar: HemisphereRegistrar) -> None:
    a = structure(7)
    b, c = moved(a, TURN.inv()), moved(a, (TURN * TURN).inv())
    chained = registered(registrar, a, b).T_target_source * registered(registrar, b, c).T_target_source
    assert_found(registered(registrar, a, c), chained)


def test_the_same_pair_gives_the_same_bytes(registrar: HemisphereRegistrar) -> None:
    target, source = structure(8), moved(structure(8), TURN.inv())
    first, second = registered(registrar, target, source), registered(registrar, target, source)
    np.testing.assert_array_equal(first.T_target_source.as_matrix(), second.T_target_source.as_matrix())
    np.testing.assert_array_equal(first.covariance, second.covariance)
    assert (first.psr, first.overlap) == (second.psr, second.overlap)


def test_scans_of_different_places_are_refused(registrar: HemisphereRegistrar) -> None:
    for seed in range(4):
        registration = registered(registrar, structure(20 + seed), structure(30 + seed))
        assert not registration.accepted
        assert "believed from" in registration.reason


def test_covariance_is_positive_definite_and_of_the_size_of_the_error(registrar: HemisphereRegistrar) -> None:
    registration = registered(registrar, structure(9), moved(structure(9), TURN.inv()))
    covariance = registration.covariance
    np.testing.assert_allclose(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0
    error = (registration.T_target_source.inv() * TURN).as_exp_coords()
    assert error @ np.linalg.solve(covariance, error) < 60


def test_says_the_ratio_of_every_step(registrar: HemisphereRegistrar) -> None:
    registration = registered(registrar, structure(10), structure(10))
    steps = dict(registration.step_psr)
    assert list(steps) == ["yaw", "tilt", "translation", "rival"]
    assert steps["translation"] == registration.psr > 3 * steps["rival"]
    assert min(steps["yaw"], steps["tilt"]) > 2
    assert registration.seconds > 0


@pytest.mark.parametrize(
    ("points", "what"),
    [
        (np.zeros((50, 3)), "fill 1 of the voxels"),
        (np.random.default_rng(1).uniform(0, 0.1, (500, 3)), "fill"),
        (np.column_stack([np.random.default_rng(2).uniform(-9, 9, (3000, 2)), np.zeros(3000)]), "one plane"),
        (np.random.default_rng(3).uniform(-9, 9, (3000, 1)) * [1.0, 0.5, 0.2], "one plane"),
    ],
)
def test_refuses_scans_without_structure(registrar: HemisphereRegistrar, points: np.ndarray, what: str) -> None:
    with pytest.raises(InputError, match=what):
        registrar.prepare(Scan(points.astype(np.float32)))


def test_config_refuses_what_makes_no_sense() -> None:
    refuses("yaw_peaks", HemisphereConfig, yaw_peaks=0)
    refuses("`max_tilt`", HemisphereConfig, max_tilt=-1.0)
    with pytest.raises(TypeError):
        HemisphereConfig(peaks=3)  # pyright: ignore[reportCallIssue]


@pytest.mark.parametrize("index", [0, 3, 6])
@pytest.mark.slow
def test_simulated_table_1(index: int) -> None:
    """The paper's S0, S3, S6 at sigma^2 = 1 m^2: within 6 degrees and 3 voxels (the whole table is measured slowly)."""
    from sonarmap.tools.lab.simulate.plan import table1_pair

    target, source, truth = table1_pair(index, seed=11, sigma2=1.0)
    registrar = HemisphereRegistrar(choose_device(), Grid(128, 2.0))
    assert_found(registrar.register(registrar.prepare(target), registrar.prepare(source)), truth, 6.0, 6.0)


def test_strength_tells_echoes_from_clutter_that_occupancy_cannot() -> None:
    """The same structure among ten times as many weak echoes, which are others in each scan."""
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


def test_strength_of_points_outside_the_grid_does_not_count() -> None:
    points = np.vstack([structure(12), np.array([[900, 0, 0]], np.float32)])
    strength = np.zeros(len(points), np.float32)
    strength[-1] = 5.0
    registrar = HemisphereRegistrar(choose_device(), Grid(EDGE, 0.4), HemisphereConfig(use_strength=True))
    prepared = registrar.prepare(Scan(points, strength))
    assert registrar.register(prepared, prepared).accepted


@pytest.mark.parametrize(("bound", "accepted"), [(3.0, False), (8.0, False), (20.0, True)])
def test_max_tilt_bounds_the_answer(bound: float, accepted: bool) -> None:
    registrar = HemisphereRegistrar(choose_device(), Grid(EDGE, 0.4), HemisphereConfig(max_tilt=np.deg2rad(bound)))
    T = turned(10.0, 2.0, 15.0, [0.5, -0.8, 0.4])
    registration = registered(registrar, structure(14), moved(structure(14), T.inv()))
    assert registration.accepted == accepted, registration.reason


@pytest.mark.parametrize(("roll", "pitch", "bound"), [(19.0, 19.0, 20.0), (-20.0, 20.0, 20.0), (34.5, 0.0, 35.0)])
@pytest.mark.parametrize("yaw", [0.0, 45.0])
def test_max_tilt_is_of_roll_and_pitch_whatever_the_yaw(yaw: float, roll: float, pitch: float, bound: float) -> None:
    """Under a yaw of 45 degrees, 20 degrees of both are 28 about one axis of the target."""
    T = turned(yaw, pitch, roll, [0.5, -0.8, 0.4])
    config = HemisphereConfig(yaw_peaks=1, refinements=0, final_refinements=0, max_tilt=np.deg2rad(bound))
    registrar = HemisphereRegistrar(choose_device(), Grid(EDGE, 0.4), config)
    registration = registered(registrar, structure(14), moved(structure(14), T.inv()))
    assert difference(registration.T_target_source, T)[0] < 5.6


def test_chosen_grid_works_without_being_told(registrar: HemisphereRegistrar) -> None:
    scans = [Scan(structure(13)), Scan(moved(structure(13), TURN.inv()))]
    own = HemisphereRegistrar(registrar.device, choose_grid(scans, EDGE))
    assert_found(own.register(*map(own.prepare, scans)), TURN)


GRID = Grid(64, 4.0)


@pytest.fixture(scope="module")
def of_the_paper() -> HemisphereRegistrar:
    return HemisphereRegistrar(choose_device(), GRID, HemisphereConfig.paper(centered=False))


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    return surface_points(build_scene("clutter", 5).mesh, 2.0).astype(np.float64)


def register(of_the_paper: HemisphereRegistrar, points: np.ndarray, T_target_source: RigidTransform) -> RigidTransform:
    moved, still = (voxel_scan(occupy(p, GRID), GRID, "s") for p in (T_target_source.apply(points), points))
    return of_the_paper.register(of_the_paper.prepare(moved), of_the_paper.prepare(still)).T_target_source


@pytest.mark.parametrize("shift", [(8.0, -16.0, 24.0), (40.0, 80.0, 12.0)])
def test_a_shift_is_exact(of_the_paper: HemisphereRegistrar, points: np.ndarray, shift: tuple[float, ...]) -> None:
    T = register(of_the_paper, points, RigidTransform.from_translation(shift))
    assert np.linalg.norm(T.translation - shift) < 0.2 * GRID.voxel
    assert np.rad2deg(T.rotation.magnitude()) < 0.5


@pytest.mark.parametrize("yaw", [-70.0, 24.0, 64.0])
def test_yaw_under_tilt_keeps_to_what_the_paper_shows(of_the_paper, points, yaw):
    """Figs. 16 and 17: 10 degrees of roll and of pitch."""
    R = Rotation.from_euler("ZYX", [yaw, 10, 10], degrees=True)
    off = register(of_the_paper, points, RigidTransform.from_rotation(R)).rotation.as_euler("ZYX", degrees=True)
    assert np.abs(off - [yaw, 10, 10])[0] < 5
    assert np.abs(off - [yaw, 10, 10])[1:].max() < 3


def test_a_grid_that_stands_still_loses_what_leaves_it(of_the_paper: HemisphereRegistrar, points: np.ndarray) -> None:
    prepared = of_the_paper.prepare(voxel_scan(occupy(points, GRID), GRID, "s"))
    assert (prepared.volume.center == 0).all()
    away = RigidTransform.from_translation([150.0, 0, 0]).apply(points).astype(np.float32)
    with pytest.raises(InputError, match="the grid of 64 voxels"):
        of_the_paper.prepare(Scan(away))
