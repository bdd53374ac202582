"""What instruments measured, in the units of the refinement: turns about the grid's center, shifts in voxels."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.grid import Grid
from sonarmap.spectral.prior import RelativePrior
from sonarmap.spectral.verify.bounds import Bounds
from sonarmap.spectral.verify.pair_frames import PairFrames
from sonarmap.spectral.verify.prior_term import PriorTerm
from tests.samples.relative_priors import ALL, ATTITUDE, DEPTH, HEADING, POSITION, T_SOURCE, T_TARGET, T_TRUE, prior

VOXEL = 0.5
TARGET_CENTER, SOURCE_CENTER = np.array([1.0, -4.0, -9.0]), np.array([-2.0, 3.0, -7.0])  # m, of the sensor
LEVELED, HEADED = (ATTITUDE, POSITION, DEPTH), (ATTITUDE, HEADING, DEPTH)


def scan(center: np.ndarray) -> Any:
    """Of a prepared scan, what is asked for."""
    points = np.random.default_rng(1).uniform(-20, 20, (50, 3))
    return SimpleNamespace(volume=SimpleNamespace(center=center), surface=SimpleNamespace(points=points))


def of(relative: RelativePrior | None) -> PairFrames:
    bounds = Bounds(np.pi, relative, VOXEL)
    return PairFrames(Grid(64, VOXEL), scan(TARGET_CENTER), scan(SOURCE_CENTER), bounds)


def pose(T: RigidTransform) -> tuple[Rotation, np.ndarray]:
    """The rotation, and the shift between the grids' centers [voxels]."""
    return T.rotation, (T.apply(SOURCE_CENTER) - TARGET_CENTER) / VOXEL


def term(relative: RelativePrior, T: RigidTransform) -> PriorTerm:
    turn, shift = pose(T)
    measured = of(relative).prior_at(Rotation.concatenate([turn]), shift[None], stretches=False)
    assert measured is not None
    return measured.of(0)


def moved(T: RigidTransform, step: np.ndarray) -> RigidTransform:
    """By a turn of the target's axes about the source's grid center, and a shift along them [rad, voxels]."""
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
    one = RigidTransform.concatenate([T])
    np.testing.assert_allclose(measured.residual, relative.residuals(one)[0], atol=1e-12)
    np.testing.assert_allclose(measured.covariance, relative.residual_covariance(one)[0], atol=1e-12)


def test_a_small_step_moves_the_residuals_as_far(relative: RelativePrior) -> None:
    step = np.array([0.004, -0.003, 0.006, 0.3, -0.2, 0.5])
    here, there = term(relative, T_TRUE), term(relative, moved(T_TRUE, step))
    change = np.abs(there.residual - here.residual)
    np.testing.assert_allclose(here.moved(step).residual, there.residual, atol=0.02 * change.max())
    assert change.max() > 0.1


@pytest.mark.parametrize("kinds", [None, (POSITION, DEPTH), (HEADING,)])
def test_none_where_nothing_is_measured_in_full(kinds: tuple[slice, ...] | None) -> None:
    known = None if kinds is None else RelativePrior(prior(T_TARGET, *kinds), prior(T_SOURCE, *kinds))
    turn, shift = pose(T_TRUE)
    assert of(known).prior_at(Rotation.concatenate([turn]), shift[None], stretches=False) is None
