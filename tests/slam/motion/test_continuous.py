"""Poses between scans: through the scans, as sure as they are, equivariant, and the spline's own laws."""

from itertools import accumulate

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.continuous import ContinuousTrajectory
from sonarmap.slam.motion.turn_rates import TurnRates

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
    first = RigidTransform.from_exp_coords([0.1, -0.2, 0.7, 3.0, -4.0, -6.0]).as_matrix()
    steps = RigidTransform.from_exp_coords(velocity * spans[:, None]).as_matrix()
    T = np.array(list(accumulate(steps, np.matmul, initial=first)))
    return Trajectory(np.concatenate([[50.0], 50.0 + np.cumsum(spans)]), RigidTransform.from_matrix(T))


def exact(knots: Trajectory) -> ContinuousTrajectory:
    return ContinuousTrajectory.through(knots, np.tile(EXACT, (len(knots), 1, 1)))


def squared(found: RigidTransform, covariances: np.ndarray, truth: RigidTransform) -> np.ndarray:
    xi = np.asarray((found.inv() * truth).as_exp_coords())
    return np.einsum("na,na->n", xi, np.linalg.solve(covariances, xi[:, :, None])[:, :, 0])


@pytest.mark.parametrize("seed", range(2))
def test_covariances_between_scans_are_calibrated(seed: int) -> None:
    truth = driven(80, seed)
    continuous = exact(truth.take(range(0, len(truth), FINE)))
    np.testing.assert_allclose(continuous.power, POWER, rtol=0.6)
    between = [k for k in range(len(truth)) if 3 <= k % FINE <= FINE - 3][:1000]
    poses, covariances = continuous.at(truth.stamps[between])
    assert len(between) == 1000
    nees = squared(poses.T_world_sensor, covariances, truth.T_world_sensor[between])
    assert 4 < nees.mean() < 8
    assert (nees < 12.6).mean() > 0.88


@pytest.mark.parametrize("sigma", [0.0, 0.1, 1.0])
def test_white_noise_of_scans_is_told_from_a_smooth_motion(sigma: float) -> None:
    """`sigma` is a share of the roots of the densities; scans between are as uncertain as they are."""
    truth, rng = driven(400, 3), np.random.default_rng(4)
    shake = sigma * np.sqrt(POWER)
    T = truth.T_world_sensor * RigidTransform.from_exp_coords(shake * rng.standard_normal((len(truth), 6)))
    known = range(0, len(truth), FINE)
    continuous = exact(Trajectory(truth.stamps[known], T[known]))
    assert (np.sqrt(continuous.shaken) < 1.3 * shake + 0.1 * np.sqrt(POWER)).all()
    assert (np.sqrt(continuous.shaken) >= 0.7 * shake).all()
    poses, covariances = continuous.at(truth.stamps)
    between = [k for k in range(len(truth)) if k % FINE]
    nees = squared(poses.T_world_sensor[between], (covariances + 2 * np.diag(continuous.shaken))[between], T[between])
    assert 4 < nees.mean() < 8


def test_steady_screw_is_interpolated_exactly() -> None:
    twist = np.array([0.02, -0.01, 0.1, 0.7, -0.2, 0.05])
    stamps = np.array([0.0, 1.0, 2.5, 3.0, 5.0])
    continuous = exact(Trajectory(stamps, RigidTransform.from_exp_coords(stamps[:, None] * twist)))
    asked = np.linspace(-0.9, 6.5, 31)  # and beyond its ends
    poses, covariances = continuous.at(asked)
    expected = RigidTransform.from_exp_coords(asked[:, None] * twist)
    np.testing.assert_allclose(poses.T_world_sensor.as_matrix(), expected.as_matrix(), atol=1e-9)
    assert np.abs(covariances).max() < 1e-8


def wiggling(seconds: int) -> tuple[Trajectory, np.ndarray]:
    """At 100 Hz: a straight way of a sensor whose attitude wiggles faster than once a second; and its turn rates."""
    stamps = 50.0 + np.arange(100 * seconds + 1) / 100
    s = stamps[:, None] - 50.0
    rates = np.array([0.0, 0.0, 0.1]) + np.array([0.05, 0.03, 0.12]) * np.sin(
        2 * np.pi * s / np.array([0.83, 0.61, 0.71]) + np.array([1.0, 0.0, 0.4])
    )
    R = [Rotation.from_euler("ZYX", [0.7, -0.2, 0.1])]
    for rate in (rates[1:] + rates[:-1]) / 200:
        R.append(R[-1] * Rotation.from_rotvec(rate))
    places = s * np.array([0.8, 0.1, -0.05]) + np.sin(s / np.array([3.0, 4.0, 5.0]))
    return Trajectory(stamps, RigidTransform.from_components(places, Rotation.concatenate(R))), rates


def test_turn_rates_recover_rotation_between_scans() -> None:
    """With a constant bias, noise, and scans that err: rotations are as good as the scans', and as sure as they are."""
    truth, rates = wiggling(30)
    rng = np.random.default_rng(0)
    sigmas = np.array([0.001, 0.002, 0.003, 0.01, 0.02, 0.015])
    off = RigidTransform.from_exp_coords(sigmas * rng.standard_normal((31, 6)))
    knots = truth.take(range(0, len(truth), 100))
    knots = Trajectory(knots.stamps, knots.T_world_sensor * off)
    measured = rates + np.array([0.02, -0.01, 0.03]) + 0.002 * rng.standard_normal(rates.shape)
    covariances = np.tile(np.diag(sigmas**2), (31, 1, 1))
    between = [k for k in range(100, len(truth) - 100) if 10 <= k % 100 <= 90]
    errors, nees = [], []
    for given in (None, TurnRates(truth.stamps, measured)):
        poses, known = ContinuousTrajectory.through(knots, covariances, given).at(truth.stamps[between])
        apart = (poses.T_world_sensor.inv() * truth.T_world_sensor[between]).rotation.magnitude()
        errors.append(float(np.sqrt((apart**2).mean())))
        nees.append(float(squared(poses.T_world_sensor, known, truth.T_world_sensor[between]).mean()))
    assert errors[1] < errors[0] / 3
    assert errors[1] < 1.2 * float(np.linalg.norm(sigmas[:3]))
    assert 3.5 < nees[1] < 8 < nees[0]


@pytest.mark.parametrize("with_rates", [False, True])
def test_trajectory_passes_through_scans_turns_with_the_world_and_extends_beyond(with_rates: bool) -> None:
    truth, rates = wiggling(12)
    given = TurnRates(truth.stamps, rates) if with_rates else None
    knots, moved = truth.take(range(100, len(truth) - 100, 100)), RigidTransform.from_exp_coords([0.4, -1, 2, 9, -2, 7])
    covariances = np.tile(EXACT, (len(knots), 1, 1))
    through, there = (
        ContinuousTrajectory.through(Trajectory(knots.stamps, T * knots.T_world_sensor), covariances, given)
        for T in (RigidTransform.identity(), moved)
    )
    poses, known = through.at(knots.stamps)
    np.testing.assert_allclose(poses.T_world_sensor.as_matrix(), knots.T_world_sensor.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(known, covariances, atol=1e-10)
    poses, known = through.at(truth.stamps)
    same, alike = there.at(truth.stamps)
    np.testing.assert_allclose(same.T_world_sensor.as_matrix(), (moved * poses.T_world_sensor).as_matrix(), atol=1e-7)
    np.testing.assert_allclose(alike, known, rtol=1e-5, atol=1e-10)
    apart = (poses.T_world_sensor.inv() * truth.T_world_sensor).rotation.magnitude()
    assert not with_rates or apart.max() < 1e-3  # a second before the first scan and behind the last, too


def test_unordered_stamps_single_pose_and_far_stamp_are_refused() -> None:
    T = RigidTransform.from_components(np.zeros((3, 3)), Rotation.identity(3))
    for stamps in ([0.0, 2.0, 1.0], [0.0, 0.0, 1.0]):
        with pytest.raises(InputError, match="whose stamps ascend"):
            exact(Trajectory(np.array(stamps), T))
    with pytest.raises(InputError, match="two or more"):
        exact(Trajectory(np.array([1.0]), T[:1]))
    with pytest.raises(InputError, match="known from 0 to 2 s"):
        exact(Trajectory(np.array([0.0, 1.0, 2.0]), T)).at(np.array([0.5, 3.1]))


def test_uncertainty_grows_beyond_the_ends() -> None:
    nees, sure = [], []
    for draw in range(60):
        truth = driven(12, draw)
        known = range(2 * FINE, 9 * FINE + 1, FINE)
        asked = [2 * FINE - 6, 9 * FINE + 3, 9 * FINE + 6]
        poses, covariances = exact(truth.take(known)).at(truth.stamps[asked])
        nees += squared(poses.T_world_sensor, covariances, truth.T_world_sensor[asked]).tolist()
        sure.append(np.trace(covariances, axis1=1, axis2=2))
    assert 4 < np.mean(nees) < 12  # eight poses tell little of how the velocity wanders
    assert (np.mean(sure, axis=0)[2] > np.mean(sure, axis=0)[1]).all()


@pytest.mark.slow
def test_errors_of_scans_appear_in_covariances_between_them() -> None:
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
        covariances = propagated(lever.inv(), covariance)
        continuous = ContinuousTrajectory.through(
            Trajectory(knots.stamps, moved * knots.T_world_sensor), covariances + EXACT
        )
        middle = 3 * FINE + FINE // 2
        pose, known = continuous.at(truth.stamps[[middle]])
        apart.append(float(squared(pose.T_world_sensor, known, truth.T_world_sensor[[middle]])[0]))
    assert 3 < np.mean(apart) < 8


def test_with_exact_scans_only_noise_of_the_rates_remains() -> None:
    truth, rates = wiggling(20)
    knots = truth.take(range(0, len(truth), 100))
    rng = np.random.default_rng(4)
    between = [k for k in range(len(truth)) if 10 <= k % 100 <= 90]
    for noise, most in ((0.0, 1e-6), (0.004, 4e-4)):
        measured = TurnRates(truth.stamps, rates + 0.05 + noise * rng.standard_normal(rates.shape))
        poses, known = ContinuousTrajectory.through(knots, np.tile(EXACT, (21, 1, 1)), measured).at(
            truth.stamps[between]
        )
        error = (poses.T_world_sensor.inv() * truth.T_world_sensor[between]).rotation.as_rotvec()
        assert np.sqrt((error**2).sum(axis=1).mean()) < most
    of_turn = np.linalg.solve(known[:, :3, :3], error[:, :, None])[:, :, 0]
    assert 1.5 < np.einsum("na,na->n", error, of_turn).mean() < 5


def test_rates_of_another_sensor_or_time_are_ignored() -> None:
    truth, rates = wiggling(12)
    knots = truth.take(range(0, len(truth), 100))
    plain, stamps = exact(knots), truth.stamps
    covariances = np.tile(EXACT, (13, 1, 1))
    strange = [
        TurnRates(stamps, 3.0 * np.sin(5.3 * stamps[:, None] + np.array([0.0, 1.0, 2.0]))),
        TurnRates(stamps + 5.0, rates),  # not known at the start
        TurnRates(np.delete(stamps, slice(300, 380)), np.delete(rates, slice(300, 380), axis=0)),  # a gap
    ]
    for given in strange:
        through = ContinuousTrajectory.through(knots, covariances, given)
        assert through.turned is None
        ours, theirs = through.at(stamps), plain.at(stamps)
        np.testing.assert_array_equal(ours[0].T_world_sensor.as_matrix(), theirs[0].T_world_sensor.as_matrix())
        np.testing.assert_array_equal(ours[1], theirs[1])
    with pytest.raises(InputError, match="ascending"):
        TurnRates(stamps[::-1], rates)
    with pytest.raises(InputError, match="all finite"):
        TurnRates(stamps, rates * np.nan)
