"""Poses that err as their covariances say lie in their ellipsoids as often as they should."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.evaluate.pose_calibration import PoseCalibration, calibrate_poses

COUNT = 4000
MOVE = RigidTransform.from_components((40.0, -7.0, 2.0), Rotation.from_euler("ZYX", (1.2, -0.3, 0.4)))


def drawn(scale: float = 1.0, anchor: float = 1e-6) -> tuple[RigidTransform, RigidTransform, np.ndarray]:
    """Poses, their truth and covariances; the errors have `scale` times the standard deviations that are told."""
    rng = np.random.default_rng(17)
    truth = RigidTransform.from_components(rng.uniform(-30, 30, (COUNT, 3)), Rotation.random(COUNT, rng=rng))
    roots = rng.normal(size=(COUNT, 6, 6)) * np.array([0.01, 0.02, 0.03, 0.3, 0.2, 0.1])[:, None]
    roots[0] = anchor * np.eye(6)
    xi = scale * np.einsum("nij,nj->ni", roots, rng.standard_normal((COUNT, 6)))
    return truth * RigidTransform.from_exp_coords(-xi), truth, roots @ np.swapaxes(roots, 1, 2)


def test_honest_poses_are_in_95_percent_of_their_ellipsoids() -> None:
    """Of 4000 independent poses: 0.95 within 0.015 (4 sigma), means within 5 sigma of 6 and of 3."""
    found, truth, covariances = drawn()
    result = calibrate_poses(MOVE * found, truth, covariances)
    assert result is not None
    assert result.anchor == "first"
    assert len(result.nees) == COUNT - 1
    assert_allclose([result.within_95, result.position_within_95], 0.95, atol=0.015)
    assert_allclose(result.nees.mean(), 6, atol=5 * np.sqrt(12 / COUNT))
    assert_allclose(result.position_nees.mean(), 3, atol=5 * np.sqrt(6 / COUNT))


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_overconfidence_shows_as_its_square(scale: float) -> None:
    result, honest = calibrate_poses(*drawn(scale)), calibrate_poses(*drawn())
    assert result is not None
    assert honest is not None
    assert_allclose(result.nees.mean(), scale**2 * honest.nees.mean(), rtol=1e-4)
    assert (result.within_95 > 0.99) == (scale < 1)


def test_poses_with_an_uncertain_first_one_are_not_aligned() -> None:
    found, truth, covariances = drawn(anchor=0.05)
    result = calibrate_poses(found, truth, covariances)
    assert result is not None
    assert (result.anchor, len(result.nees)) == ("world", COUNT)
    moved = calibrate_poses(MOVE * found, truth, covariances)
    assert moved is not None
    assert moved.nees.mean() > 100 * result.nees.mean()


def test_an_anchor_alone_says_nothing() -> None:
    found, truth, covariances = drawn()
    assert calibrate_poses(found[:1], truth[:1], covariances[:1]) is None


def test_a_known_error_has_its_known_distance() -> None:
    """0.2 rad about y at sigma 0.1, and 0.6 m along the body's z at sigma 0.3: 4 + 4."""
    truth = RigidTransform.concatenate([RigidTransform.identity(), MOVE])
    off = RigidTransform.from_exp_coords([[0, 0.2, 0, 0, 0, 0.6]])
    found = RigidTransform.concatenate([RigidTransform.identity(), (MOVE * off.inv())[0]])
    sigmas = np.diag([0.5, 0.1, 0.5, 0.7, 0.7, 0.3]) ** 2
    result = calibrate_poses(found, truth, np.stack([1e-12 * np.eye(6), sigmas]))
    assert result is not None
    assert_allclose([result.nees[0], result.position_nees[0]], [8, 4], rtol=1e-9)


def calibrated(*arguments) -> PoseCalibration:
    result = calibrate_poses(*arguments)
    assert result is not None
    return result


@pytest.mark.parametrize(
    ("unmeasured", "motion"),
    [
        (("heading", "east", "north"), (0.0, 0.0, 1.3, 40.0, -9.0, 0.0)),
        (("heading",), (0.0, 0.0, -0.7, 0.0, 0.0, 0.0)),
        (("tilt_x", "tilt_y", "up"), (0.4, -0.2, 0.3, 0.0, 0.0, 5.0)),
        ((), (0.0,) * 6),
    ],
)
def test_what_no_instrument_measured_is_aligned_at_the_first_pose(unmeasured, motion):
    """The estimate is the truth moved about its first pose in just these directions; the rest may not be moved."""
    truth = drawn()[1]
    covariances = np.broadcast_to(np.diag([0.01**2] * 3 + [0.1**2] * 3), (len(truth), 6, 6))
    place = RigidTransform.from_translation(truth[0].translation)
    turn = RigidTransform.from_rotation(Rotation.from_rotvec(motion[:3]))
    found = RigidTransform.from_translation(motion[3:]) * place * turn * place.inv() * truth
    result = calibrated(found, truth, covariances, unmeasured)
    assert result.anchor == ("partly" if unmeasured else "world")
    np.testing.assert_allclose(result.nees, 0, atol=1e-12)
    if unmeasured:
        assert calibrated(found, truth, covariances).nees.max() > 100
    raised = RigidTransform.from_translation([0.0, 0.0, 1.0]) * truth
    assert calibrated(raised, truth, covariances, ("heading", "east", "north")).nees.min() > 50
