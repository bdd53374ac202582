"""Laws that any registration obeys, over all rotations and over the hemisphere: inverse, equivariance, composition."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere import HemisphereRegistrar
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.result import Registrar, Registration
from tests.samples.scenes import reliefs
from tests.samples.scenes.structures import TURN, assert_near, moved, registered, structure

Points = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, slots=True)
class Method:
    """A method, and pairs of scans of numbered places with a known transform."""

    registrar: Registrar
    truth: RigidTransform
    pair: Callable[[int], Points]
    turned: Callable[[float], tuple[RigidTransform, Points]]
    steps: tuple[str, ...]
    near: tuple[float, float]  # how near it comes [deg, m]

    def register(self, target: np.ndarray, source: np.ndarray) -> Registration:
        return registered(self.registrar, target, source)

    def assert_found(self, registration: Registration, truth: RigidTransform) -> None:
        assert registration.accepted, registration.reason
        assert_near(registration.T_target_source, truth, *self.near)


def relief_from(seed: int, there: RigidTransform = reliefs.THERE) -> Points:
    return reliefs.seen(reliefs.relief(seed), reliefs.HERE), reliefs.seen(reliefs.relief(seed), there)


def relief_turned(yaw: float) -> tuple[RigidTransform, Points]:
    there = reliefs.above(3, -2, 13, yaw, 4, -7)
    return reliefs.HERE.inv() * there, relief_from(4, there)


def structure_from(seed: int, T: RigidTransform = TURN) -> Points:
    return structure(seed), moved(structure(seed), T.inv())


def structure_turned(yaw: float) -> tuple[RigidTransform, Points]:
    T = RigidTransform.from_components([0.8, 1.1, -0.5], Rotation.from_euler("ZYX", [yaw, 3, -5], degrees=True))
    return T, structure_from(4, T)


@pytest.fixture(scope="module", params=["all rotations", "hemisphere"])
def method(request: pytest.FixtureRequest) -> Method:
    """The first within a tenth of a rotation's bin and a fifth of a voxel, the second within one of each."""
    device = choose_device()
    if request.param == "hemisphere":
        steps = "yaw", "tilt", "translation", "rival"
        registrar = HemisphereRegistrar(device, Grid(64, 0.4))
        return Method(registrar, TURN, structure_from, structure_turned, steps, (2.8, 0.4))
    steps = "rotation", "candidate", "translation"
    registrar = SpectralRegistrar(device, Grid(64, 0.5))
    return Method(registrar, reliefs.T_TRUE, relief_from, relief_turned, steps, (0.3, 0.1))


@pytest.mark.quick_cases(1)
def test_a_scan_registers_to_itself(method: Method) -> None:
    points = method.pair(1)[1]
    registration = method.register(points, points)
    assert_near(registration.T_target_source, RigidTransform.identity(), 0.05, 0.01)
    assert registration.overlap == 1.0


def test_finds_a_known_transform_and_reports_the_psr_of_every_step(method: Method) -> None:
    registration = method.register(*method.pair(1))
    method.assert_found(registration, method.truth)
    steps = dict(registration.step_psr)
    assert tuple(steps) == method.steps
    assert min(steps.values()) > 0
    assert steps["translation"] == registration.psr == max(steps.values())
    assert registration.seconds > 0
    assert 0.7 < registration.overlap <= 1
    covariance, error = registration.covariance, (registration.T_target_source.inv() * method.truth).as_exp_coords()
    np.testing.assert_allclose(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0
    assert error @ np.linalg.solve(covariance, error) < 60


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("yaw", [-170.0, 100.0])
def test_yaw_covers_the_circle(method: Method, yaw: float) -> None:
    truth, points = method.turned(yaw)
    method.assert_found(method.register(*points), truth)


@pytest.mark.quick_cases(1)
def test_swapping_the_scans_gives_the_inverse(method: Method) -> None:
    there, back = (method.register(*points) for points in (method.pair(5), method.pair(5)[::-1]))
    method.assert_found(back, there.T_target_source.inv())
    assert back.overlap == pytest.approx(there.overlap, abs=0.03)


@pytest.mark.quick_cases(1)
def test_moving_the_source_moves_the_transform(method: Method) -> None:
    target, source = method.pair(6)
    Q = RigidTransform.from_components([30.0, -12.0, 5.0], Rotation.from_euler("ZYX", [70, 6, 9], degrees=True))
    plain, other = method.register(target, source), method.register(target, moved(source, Q))
    method.assert_found(other, plain.T_target_source * Q.inv())


@pytest.mark.quick_cases(1)
def test_transforms_compose(method: Method) -> None:
    a, *rest = method.pair(7)[0], TURN, TURN * TURN
    b, c = (moved(a, T.inv()) for T in rest)
    steps = [method.register(*pair).T_target_source for pair in ((a, b), (b, c))]
    method.assert_found(method.register(a, c), steps[0] * steps[1])


@pytest.mark.quick_cases(1)
def test_the_same_pair_gives_the_same_bytes(method: Method) -> None:
    first, second = (method.register(*points) for points in (method.pair(7), method.pair(7)))
    for what in ("covariance", "psr", "overlap", "probability", "step_psr", "reason"):
        np.testing.assert_array_equal(getattr(first, what), getattr(second, what))
    np.testing.assert_array_equal(first.T_target_source.as_matrix(), second.T_target_source.as_matrix())
