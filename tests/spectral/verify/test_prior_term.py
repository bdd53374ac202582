"""The prior term of instruments in the refinement, and its balance with the planes."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.grid import Grid
from sonarmap.spectral.prior import RelativePrior
from sonarmap.spectral.verify.bounds import Bounds, PairFrames
from sonarmap.spectral.verify.fit import PriorTerm
from tests.kernels.surface import steps
from tests.samples.relative_priors import ALL, ATTITUDE, DEPTH, HEADING, POSITION, T_SOURCE, T_TARGET, T_TRUE, prior

HEIGHT = np.array([[0.0, 0, 0, 0, 0, 1]])  # an instrument that measures the shift along z alone
NOTHING = np.zeros((6, 6))
FIRM = np.diag(0.5 / np.array([400.0, 300, 500, 90, 80, 70]))  # covariance by planes of so much information


def height(off: float, sigma: float) -> PriorTerm:
    """A prior term of a pose that is `off` above the measurement."""
    return PriorTerm(np.array([off]), HEIGHT, np.array([[sigma**2]]), NOTHING)


def posterior_step(step: np.ndarray, covariance: np.ndarray, term: PriorTerm) -> np.ndarray:
    """The step by scans and instruments that the device computes, by its twin."""
    parts = term.residual, term.jacobian, term.covariance, term.systematic
    (one,) = PriorTerm(*(part[None] for part in parts)).for_device()
    return steps.posterior_step(step, covariance, one["off"], one)


def test_scans_and_instrument_meet_where_their_variances_say() -> None:
    """The planes put z at 0.4, with a variance of 0.5 / 70, and the instrument at -0.1."""
    step = np.array([0, 0, 0, 0.3, 0, 0.4])
    found = posterior_step(step, FIRM, height(0.1, 0.2))
    scans, instrument = 0.5 / 70, 0.2**2
    expected = (0.4 / scans - 0.1 / instrument) / (1 / scans + 1 / instrument)
    assert found[5] == pytest.approx(expected, rel=1e-4)
    assert found[3] == pytest.approx(0.3, rel=1e-4)


def test_directions_without_planes_follow_the_measurement() -> None:
    flat = np.diag([1e-3, 1e-3, 1e9, 1e9, 1e9, 7e-3])
    everything = PriorTerm(
        np.array([0.02, -0.03, 0.04, 2.0, -1.5, 0.0]), np.eye(6), np.diag([1e-4] * 3 + [1.0] * 3), NOTHING
    )
    found = posterior_step(np.zeros(6), flat, everything)
    np.testing.assert_allclose(found[2:5], [-0.04, -2.0, 1.5], rtol=1e-3)
    assert abs(found[0]) < 0.02
    # without any planes only the instruments move it
    found = posterior_step(np.zeros(6), 1e9 * np.eye(6), height(0.7, 0.1))
    np.testing.assert_allclose(found, [0, 0, 0, 0, 0, -0.7], atol=1e-3)


class TestDistortion:
    COVARIANCE = np.diag([1e-4] * 3 + [0.01] * 3)

    def at(self, sigmas: float) -> float:
        """The variance of z that is added where the best fit is so many standard deviations from what was measured."""
        term = height(0.0, 0.2)
        deviation = np.sqrt(0.01 + 0.2**2)
        added = term.distortion(self.COVARIANCE, np.array([0, 0, 0, 5.0, 0, sigmas * deviation]))
        rest = added.copy()
        rest[5, 5] = 0
        np.testing.assert_allclose(rest, 0, atol=1e-12)
        return float(added[5, 5])

    def test_scans_lose_weight_with_their_deviation_from_the_instrument(self) -> None:
        assert self.at(0.0) == self.at(-2.0) == self.at(2.9) == 0
        added = [self.at(sigmas) for sigmas in (3.1, 3.4, 3.7, 3.95)]
        assert (np.diff(added) > 0).all()
        assert added[0] > 0

    @pytest.mark.parametrize("sigmas", [4.5, -12.0])
    def test_far_beyond_the_pose_is_the_instruments(self, sigmas: float) -> None:
        """The step ends where it was measured, though the planes are firm."""
        far = sigmas * np.sqrt(0.5 / 70 + 0.2**2)
        found = posterior_step(np.array([0, 0, 0, 0.3, 0, far]), FIRM, height(0, 0.2))
        assert abs(found[5]) < 1e-3 * abs(far)
        assert found[3] == pytest.approx(0.3, rel=1e-3)


VOXEL = 0.5
TARGET_CENTER, SOURCE_CENTER = np.array([1.0, -4.0, -9.0]), np.array([-2.0, 3.0, -7.0])  # m, of the sensor
LEVELED, HEADED = (ATTITUDE, POSITION, DEPTH), (ATTITUDE, HEADING, DEPTH)


def scan(center: np.ndarray) -> Any:
    """The fields of a prepared scan that the test needs."""
    points = np.random.default_rng(1).uniform(-20, 20, (50, 3))
    lever = float(np.sqrt((points**2).sum(axis=1).mean()))
    return SimpleNamespace(volume=SimpleNamespace(center=center), surface=SimpleNamespace(lever=lever))


def of(relative: RelativePrior | None) -> PairFrames:
    bounds = Bounds(np.pi, relative, VOXEL)
    return PairFrames(Grid(64, VOXEL), scan(TARGET_CENTER), scan(SOURCE_CENTER), bounds)


def pose(T: RigidTransform) -> tuple[Rotation, np.ndarray]:
    """The rotation, and the shift between the grids' centers [voxels]."""
    return T.rotation, (T.apply(SOURCE_CENTER) - TARGET_CENTER) / VOXEL


def term(relative: RelativePrior, T: RigidTransform) -> PriorTerm:
    turn, shift = pose(T)
    return of(relative).prior_at(relative, Rotation.concatenate([turn]), shift[None], stretches=False).of(0)


def moved(T: RigidTransform, step: np.ndarray) -> RigidTransform:
    """Pose after a turn about the target's axes at the source's grid center and a shift along them [rad, voxels]."""
    R = Rotation.from_rotvec(step[:3]) * T.rotation
    center = T.apply(SOURCE_CENTER) + VOXEL * step[3:]
    return RigidTransform.from_components(center - R.apply(SOURCE_CENTER), R)


@pytest.fixture(params=[(ALL, ALL), (HEADED, HEADED), (LEVELED, ALL)], ids=["all", "no position", "by the source"])
def relative(request: pytest.FixtureRequest) -> RelativePrior:
    target, source = request.param
    return RelativePrior(prior(T_TARGET, *target), prior(T_SOURCE, *source))


def test_the_jacobian_is_of_steps_of_the_refinement(relative: RelativePrior) -> None:
    shifted = RigidTransform.from_translation([0.4, -0.3, 0.2]) * T_TRUE
    jacobian, step = term(relative, shifted).jacobian, 1e-5
    ahead, behind = ([term(relative, moved(shifted, sign * step * e)).residual for e in np.eye(6)] for sign in (1, -1))
    np.testing.assert_allclose(jacobian, np.transpose(np.subtract(ahead, behind)) / (2 * step), atol=1e-5)


def test_residuals_and_covariance_are_of_the_sensors_pose(relative: RelativePrior) -> None:
    T = RigidTransform.from_translation([0.4, -0.3, 0.2]) * T_TRUE
    measured = term(relative, T)
    off = relative.at(T.rotation, T.translation)
    np.testing.assert_allclose(measured.residual, off.residual[0], atol=1e-12)
    np.testing.assert_allclose(measured.covariance, off.covariance[0], atol=1e-12)


def test_shared_errors_of_points_give_the_instrument_more_weight() -> None:
    step = np.array([0, 0, 0, 0, 0, 0.4])
    plain = height(0.1, 0.2)
    shared = PriorTerm(plain.residual, HEIGHT, plain.covariance, np.diag([0, 0, 0, 0, 0, 0.2**2 - 0.5 / 70]))
    found = posterior_step(step, FIRM, shared)
    assert found[5] == pytest.approx((0.4 - 0.1) / 2, rel=1e-4)


@pytest.mark.parametrize("kinds", [(POSITION, DEPTH), (HEADING,)])
def test_there_is_no_term_without_a_full_measurement(kinds: tuple[slice, ...]) -> None:
    assert not RelativePrior(prior(T_TARGET, *kinds), prior(T_SOURCE, *kinds)).measures
