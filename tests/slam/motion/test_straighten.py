"""Scans that a moving sensor bent come out straight, by the way that is given, and in a map that finds it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap import map_scans
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.straighten import Straightened, sharper, straightened, ways
from sonarmap.slam.motion.turn_rates import TurnRates
from sonarmap.slam.pair import Pair
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.simulation import TRAJECTORIES, simulate

COUNT, DOTS = 12, 200
TIMES = np.linspace(0.0, 0.8, DOTS, dtype=np.float32)
TWIST = np.array([0.01, -0.02, 0.15, 0.9, 0.1, -0.05])  # a steady screw, per second


def pose(stamps: np.ndarray) -> RigidTransform:
    return RigidTransform.from_exp_coords(np.asarray(stamps)[:, None] * TWIST)


def seen(stamp: float, rng: np.random.Generator, world: RigidTransform) -> tuple[Scan, np.ndarray]:
    """A scan of dots about its place, each in the sensor's frame at its own time, and as it would be at the stamp."""
    at_stamp, at_times = (world * pose(np.array(stamps)) for stamps in ([stamp], stamp + TIMES))
    dots = at_stamp[0].apply(rng.uniform(-10, 10, (DOTS, 3)))
    points = at_times.inv().apply(dots).astype(np.float32)
    return Scan(points, stamp=stamp, times=TIMES, name=f"scan{stamp:g}"), at_stamp[0].inv().apply(dots)


@pytest.mark.parametrize("world", [RigidTransform.from_exp_coords([1, -2, 0.5, 90, -40, 3])])
def test_points_are_in_the_frame_at_the_stamp(world: RigidTransform) -> None:
    rng, stamps = np.random.default_rng(3), 5.0 + np.arange(float(COUNT))
    scans, expected = zip(*(seen(stamp, rng, world) for stamp in stamps.tolist()), strict=True)
    plain = replace(scans[4], times=None)
    given = [*scans[:4], plain, *scans[5:]]
    straight = straightened(given, Trajectory(stamps, world * pose(stamps)), [list(range(COUNT))], seen_from=0.5)
    for k, (scan, points) in enumerate(zip(straight.scans, expected, strict=True)):
        if k == 4:
            assert (scan, straight.moved[k]) == (plain, 0.0)
            continue
        np.testing.assert_allclose(scan.points, points, atol=2e-5)
        assert scan.times is None
        assert scan.viewpoints is not None  # the sensor went 0.7 m
        np.testing.assert_allclose(scan.viewpoints[[0, -1]], pose(TIMES[[0, -1]]).translation, atol=1e-5)
        assert straight.moved[k] == pytest.approx(
            np.quantile(np.linalg.norm(scan.points - scans[k].points, axis=1), 0.95), rel=1e-6
        )
    assert straight.farthest_from(Straightened.none(given)) == pytest.approx(straight.moved.max())
    still = straightened(given, Trajectory(stamps, world * pose(stamps)), [list(range(COUNT))], seen_from=1.0)
    assert all(scan.viewpoints is None for scan in still.scans)


def test_poses_of_bent_scans_are_those_at_the_middle() -> None:
    rng, stamps = np.random.default_rng(4), np.arange(float(COUNT))
    identity = RigidTransform.identity()
    scans, expected = zip(*(seen(stamp, rng, identity) for stamp in stamps.tolist()), strict=True)
    as_registered = Trajectory(stamps, pose(stamps + TIMES.mean()))
    straight = straightened(scans, as_registered, [list(range(COUNT))], seen_from=0.5, bent=True)
    for scan, points in zip(straight.scans, expected, strict=True):
        np.testing.assert_allclose(scan.points, points, atol=2e-5)


def test_turn_rates_straighten_rotation_faster_than_the_scans() -> None:
    """A sensor that shakes its head between the scans, and what its gyroscope measured of that, with a bias."""
    rng, stamps = np.random.default_rng(6), np.arange(float(COUNT))

    def shaken(times: np.ndarray) -> RigidTransform:
        angles = np.radians(6.0) * np.sin(2 * np.pi * np.asarray(times) / 0.7)
        return pose(times) * RigidTransform.from_rotation(Rotation.from_euler("z", angles[:, None]))

    scans, expected = [], []
    for stamp in stamps.tolist():
        there, then = shaken(np.array([stamp]))[0], shaken(stamp + TIMES.astype(np.float64))
        dots = there.apply(rng.uniform(-10, 10, (DOTS, 3)))
        scans.append(Scan(then.inv().apply(dots).astype(np.float32), stamp=stamp, times=TIMES))
        expected.append(there.inv().apply(dots))
    known = np.arange(-1.0, COUNT + 1.0, 0.005)
    turned = shaken(known).rotation
    rates = TurnRates((known[1:] + known[:-1]) / 2, (turned[:-1].inv() * turned[1:]).as_rotvec() / 0.005 + 0.04)
    way, runs = Trajectory(stamps, shaken(stamps)), [list(range(COUNT))]
    plain, gyro = (straightened(scans, way, runs, seen_from=0.5, turn_rates=given) for given in (None, rates))
    # the last scan goes on beyond what is known of the way
    off = [
        [np.abs(scan.points - points).max() for scan, points in zip(straight.scans[:-1], expected, strict=False)]
        for straight in (plain, gyro)
    ]
    assert min(off[0]) > 0.5
    assert max(off[1]) < 0.03
    # poses that err by 2 degrees, as of scans that are still bent, bend none by as much
    turns = RigidTransform.from_rotation(Rotation.from_rotvec(np.radians(2.0) * rng.standard_normal((COUNT, 3))))
    rough = straightened(scans, Trajectory(stamps, shaken(stamps) * turns), runs, seen_from=0.5, turn_rates=rates)
    assert max(np.abs(rough.scans[k].points - expected[k]).max() for k in range(COUNT - 1)) < 0.2


def test_scans_without_a_known_trajectory_are_unchanged() -> None:
    rng, stamps = np.random.default_rng(5), np.arange(float(COUNT))
    scans = [seen(stamp, rng, RigidTransform.identity())[0] for stamp in stamps.tolist()]
    late = replace(scans[-1], times=TIMES + np.float32(1.5))  # beyond what the last step tells
    trajectory = Trajectory(stamps, pose(stamps))
    runs = [[0, 1, 2], list(range(3, COUNT))]
    straight = straightened([*scans[:-1], late], trajectory, runs, seen_from=0.5)
    assert all(ours is given for ours, given in zip(straight.scans[:3], scans[:3], strict=True))  # too few
    assert straight.scans[-1] is late
    assert (straight.moved > 0).tolist() == 3 * [False] + 8 * [True] + [False]
    counted = Trajectory(0.5 * stamps, pose(stamps))  # numbers of scans, that are no seconds
    restamped = [replace(scan, stamp=0.5 * scan.stamp) for scan in scans]
    assert not straightened(restamped, counted, runs, seen_from=0.5).moved.any()


def test_runs_end_with_components_surveys_and_clocks() -> None:
    stamps = np.array([0.0, 1.0, 2.0, 1.5, 2.5, 7.0, 8.0])
    assert ways([[0, 1, 2, 3, 4], [5, 6]], [0, 0, 0, 0, 1, 1, 1], stamps) == [[0, 1, 2], [3], [4], [5, 6]]


@pytest.mark.slow
def test_map_straightens_bent_scans_and_leaves_others() -> None:
    """Of a sonar that takes its columns in turn over half the time to the next scan, above a wreck."""
    settings = plan("wreck", seed=7)
    quiet = replace(settings.noise, ghosts=0.0)
    settings = replace(settings, count=16, spacing=3.0, noise=quiet, sweep=0.5)
    simulation = simulate(settings)
    way = TRAJECTORIES["survey"](replace(settings, count=17))
    runs = [list(range(16))]
    truth = straightened(simulation.scans, way.take(runs[0]), runs, seen_from=1.0).scans
    result = map_scans(simulation.scans)
    assert result.straightened is not None
    assert min(result.straightened) > 0.3
    found = straightened(simulation.scans, result.trajectory, runs, seen_from=1.0).scans

    def error(scans: Sequence[Scan]) -> float:
        both = zip(scans[1:-1], truth[1:-1], strict=True)
        return float(np.median([np.sqrt(((a.points - b.points) ** 2).sum(axis=1).mean()) for a, b in both]))

    assert error(found) < error(simulation.scans) / 3
    T, U = result.trajectory.T_world_sensor, simulation.truth.T_world_sensor
    # of a sonar that stands still, or whose points have been straightened, times must do no harm
    straight = [replace(scan, times=bent.times) for scan, bent in zip(truth[:8], simulation.scans, strict=False)]
    assert map_scans(straight).straightened is None
    turns = ((T[:-1].inv() * T[1:]).inv() * (U[:-1].inv() * U[1:])).rotation.magnitude()
    assert np.degrees(np.median(turns)) < 0.5


def test_sharper_compares_peaks_of_pairs_accepted_both_times() -> None:
    def pairs(*peaks: tuple[int, float, bool]) -> list[Pair]:
        T = RigidTransform.from_components([1.0, 0, 0], Rotation.identity())
        return [
            Pair(i, i + 1, "sequential", registration=Registration(T, np.eye(6), psr, 0.5, accepted, 0.0, ""))
            for i, psr, accepted in peaks
        ]

    before = pairs((0, 100.0, True), (1, 50.0, True), (2, 80.0, False), (3, 10.0, True))
    assert sharper(pairs((0, 110.0, True), (1, 60.0, True), (2, 8.0, True)), before) > 0
    assert sharper(pairs((0, 90.0, True), (1, 60.0, False)), before) < 0
    assert sharper(pairs((7, 90.0, True)), before) == 0
