"""Poses between scans: through the scans, as sure as they are, equivariant, and the spline's own laws."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.continuous import ContinuousTrajectory

POWER = np.array([2e-4, 1e-4, 4e-4, 1e-2, 2e-2, 5e-3])
FINE = 20  # steps of the truth from knot to knot
EXACT = 1e-10 * np.eye(6)


def driven(count: int, seed: int) -> Trajectory:
    """A way whose body velocity is driven by white noise, at uneven times, FINE poses from knot to knot."""
    rng = np.random.default_rng(seed)
    spans = np.repeat(rng.uniform(0.5, 1.5, count - 1), FINE) / FINE
    velocity = np.array([0.0, 0.0, 0.05, 0.8, 0.1, 0.0]) + np.cumsum(
        np.sqrt(POWER * spans[:, None]) * rng.standard_normal((len(spans), 6)), axis=0
    )
    T = [RigidTransform.from_exp_coords([0.1, -0.2, 0.7, 3.0, -4.0, -6.0])]
    for step in velocity * spans[:, None]:
        T.append(T[-1] * RigidTransform.from_exp_coords(step))
    return Trajectory(np.concatenate([[50.0], 50.0 + np.cumsum(spans)]), RigidTransform.concatenate(T))


def exact(knots: Trajectory) -> ContinuousTrajectory:
    return ContinuousTrajectory.through(knots, np.tile(EXACT, (len(knots), 1, 1)))


def squared(found: RigidTransform, covariances: np.ndarray, truth: RigidTransform) -> np.ndarray:
    xi = np.asarray((found.inv() * truth).as_exp_coords())
    return np.einsum("na,na->n", xi, np.linalg.solve(covariances, xi[:, :, None])[:, :, 0])


@pytest.mark.parametrize("seed", range(3))
def test_a_thousand_poses_are_as_far_off_as_they_say(seed: int) -> None:
    truth = driven(80, seed)
    continuous = exact(truth.take(range(0, len(truth), FINE)))
    np.testing.assert_allclose(continuous.power, POWER, rtol=0.6)
    between = [k for k in range(len(truth)) if 3 <= k % FINE <= FINE - 3][:1000]
    poses, covariances = continuous.at(truth.stamps[between])
    assert len(between) == 1000
    nees = squared(poses.T_world_sensor, covariances, truth.T_world_sensor[between])
    assert 4 < nees.mean() < 8
    assert (nees < 12.6).mean() > 0.88


def test_errors_of_scans_are_there_between_them() -> None:
    """All knots are off by one error: so are the poses between."""
    truth = driven(40, 5)
    rng = np.random.default_rng(1)
    covariance = np.diag(np.array([0.01, 0.02, 0.03, 0.1, 0.2, 0.15]) ** 2)
    apart = []
    for _ in range(200):
        # in the world, as the whole map may lie a bit aside
        knots = truth.take(range(0, 8 * FINE, FINE))
        off = RigidTransform.from_exp_coords(rng.multivariate_normal(np.zeros(6), covariance))
        first = knots.T_world_sensor[0]
        moved = first * off * first.inv()
        lever = first.inv() * knots.T_world_sensor
        A = np.stack([RigidTransform.from_matrix(m).inv().as_matrix() for m in lever.as_matrix()])
        covariances = np.stack([adjoint_by_hand(a) @ covariance @ adjoint_by_hand(a).T for a in A])
        continuous = ContinuousTrajectory.through(
            Trajectory(knots.stamps, moved * knots.T_world_sensor), covariances + EXACT
        )
        middle = 3 * FINE + FINE // 2
        pose, known = continuous.at(truth.stamps[[middle]])
        apart.append(float(squared(pose.T_world_sensor, known, truth.T_world_sensor[[middle]])[0]))
    assert 3 < np.mean(apart) < 8


def adjoint_by_hand(T: np.ndarray) -> np.ndarray:
    R, (x, y, z) = T[:3, :3], T[:3, 3]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.block([[R, np.zeros((3, 3))], [cross @ R, R]])


def test_it_passes_through_the_scans_and_turns_with_the_world() -> None:
    knots = driven(12, 7).take(range(0, 11 * FINE + 1, FINE))
    continuous = exact(knots)
    poses, covariances = continuous.at(knots.stamps)
    np.testing.assert_allclose(poses.T_world_sensor.as_matrix(), knots.T_world_sensor.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(covariances, np.tile(EXACT, (12, 1, 1)), atol=1e-12)
    moved = RigidTransform.from_exp_coords([0.4, -1.0, 2.0, 100.0, -20.0, 7.0])
    stamps = np.linspace(knots.stamps[0], knots.stamps[-1], 50)
    there, same = exact(Trajectory(knots.stamps, moved * knots.T_world_sensor)).at(stamps)
    here, covariances = continuous.at(stamps)
    np.testing.assert_allclose(there.T_world_sensor.as_matrix(), (moved * here.T_world_sensor).as_matrix(), atol=1e-9)
    np.testing.assert_allclose(same, covariances, rtol=1e-6, atol=1e-12)


def test_a_steady_screw_is_exact_and_sure() -> None:
    twist = np.array([0.02, -0.01, 0.1, 0.7, -0.2, 0.05])
    stamps = np.array([0.0, 1.0, 2.5, 3.0, 5.0])
    continuous = exact(Trajectory(stamps, RigidTransform.from_exp_coords(stamps[:, None] * twist)))
    asked = np.linspace(-0.9, 6.5, 31)  # and beyond its ends
    poses, covariances = continuous.at(asked)
    expected = RigidTransform.from_exp_coords(asked[:, None] * twist)
    np.testing.assert_allclose(poses.T_world_sensor.as_matrix(), expected.as_matrix(), atol=1e-9)
    assert np.abs(covariances).max() < 1e-8


def test_the_variance_is_that_of_the_process() -> None:
    """Beside the dense twin: integrated Brownian motion, of which the values at the knots are known."""
    knots = np.array([0.0, 1.0, 1.5, 3.5, 4.0, 6.0])
    asked = np.array([0.3, 1.2, 2.5, 3.0, 3.9, 5.5])

    def kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Of a process that starts anywhere, at any velocity, plus what the first 100 s add."""
        a, b = a[:, None] + 100.0, b[None, :] + 100.0
        low, high = np.minimum(a, b), np.maximum(a, b)
        return low**2 * (3 * high - low) / 6 + 1e6 + 1e4 * a * b

    gain = np.linalg.solve(kernel(knots, knots), kernel(knots, asked))
    expected = np.diag(kernel(asked, asked) - kernel(asked, knots) @ gain)
    still = RigidTransform.from_translation(np.random.default_rng(0).standard_normal((6, 3)) * [1.0, 0.0, 0.0])
    continuous = exact(Trajectory(knots, still))
    _, covariances = continuous.at(asked)
    np.testing.assert_allclose(covariances[:, 3, 3] / continuous.power[3], expected, rtol=5e-3)  # the twin loses digits


def test_what_cannot_be_told_is_refused() -> None:
    T = RigidTransform.from_components(np.zeros((3, 3)), Rotation.identity(3))
    for stamps in ([0.0, 2.0, 1.0], [0.0, 0.0, 1.0]):
        with pytest.raises(InputError, match="whose stamps ascend"):
            exact(Trajectory(np.array(stamps), T))
    with pytest.raises(InputError, match="two or more"):
        exact(Trajectory(np.array([1.0]), T[:1]))
    with pytest.raises(InputError, match="known from 0 to 2 s"):
        exact(Trajectory(np.array([0.0, 1.0, 2.0]), T)).at(np.array([0.5, 3.1]))


@pytest.mark.parametrize("seed", range(3))
def test_beyond_the_ends_it_is_less_and_less_sure(seed: int) -> None:
    nees, sure = [], []
    for draw in range(60):
        truth = driven(12, 100 * seed + draw)
        known = range(2 * FINE, 9 * FINE + 1, FINE)
        asked = [2 * FINE - 6, 9 * FINE + 3, 9 * FINE + 6]
        poses, covariances = exact(truth.take(known)).at(truth.stamps[asked])
        nees += squared(poses.T_world_sensor, covariances, truth.T_world_sensor[asked]).tolist()
        sure.append(np.trace(covariances, axis1=1, axis2=2))
    assert 4 < np.mean(nees) < 12  # eight poses tell little of how the velocity wanders
    assert (np.mean(sure, axis=0)[2] > np.mean(sure, axis=0)[1]).all()
