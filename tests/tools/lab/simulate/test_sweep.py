"""Scans of a sensor that measures its columns one after another while it moves."""

from dataclasses import replace

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.motion.continuous import ContinuousTrajectory
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.simulation import TRAJECTORIES, simulate, trajectory_of


def test_columns_are_measured_one_after_another_along_the_path() -> None:
    """Each point lies where a beam from the sensor's pose at its time meets the scene."""
    settings = replace(plan("harbor", seed=4), count=3, noise=Noise(), sweep=0.6)
    scans = simulate(settings).scans
    longer = TRAJECTORIES["survey"](replace(settings, count=4))
    path = ContinuousTrajectory.through(longer, np.zeros((4, 6, 6)))
    scene = build_scene("harbor", 4)
    for number, scan in enumerate(scans):
        assert scan.times is not None
        assert 0.0 <= scan.times.min() <= scan.times.max() < 0.6
        chosen = np.linspace(0, len(scan.points) - 1, 40).astype(int)
        T = path.at(number + np.sort(scan.times[chosen].astype(np.float64)))[0].T_world_sensor
        points = scan.points[chosen[np.argsort(scan.times[chosen])]].astype(np.float64)
        ranges = np.linalg.norm(points, axis=1)
        found, _ = scene.intersect(T.translation, T.rotation.apply(points / ranges[:, None]))
        np.testing.assert_allclose(ranges, found, atol=0.05)  # in steps of 2.5 cm
    still = simulate(replace(settings, sweep=0.0)).scans[1].points
    slow = simulate(replace(settings, sweep=1e-6)).scans[1].points
    np.testing.assert_allclose(slow, still, atol=0.03)
    with pytest.raises(InputError, match="0 to 1"):
        replace(settings, sweep=1.5)
    with pytest.raises(InputError, match="ghosts"):
        replace(settings, noise=replace(settings.noise, ghosts=0.1))


def test_speed_and_turn_rate_are_as_set() -> None:
    """Scans are 1 s apart, so 0.5 m apart is 0.5 m/s; besides the path's turns the sensor swings to and fro."""
    plain = replace(plan("pool", seed=4), count=25, spacing=0.5)
    still, turning = (trajectory_of(replace(plain, turn=turn)) for turn in (0.0, np.radians(30.0)))
    np.testing.assert_array_equal(turning.T_world_sensor.translation, still.T_world_sensor.translation)
    steps = np.linalg.norm(np.diff(still.T_world_sensor.translation, axis=0), axis=1)
    np.testing.assert_allclose(np.median(steps), 0.5, rtol=0.1)
    swing = (still.T_world_sensor.inv() * turning.T_world_sensor).rotation.as_rotvec()
    np.testing.assert_allclose(swing[:, :2], 0.0, atol=1e-12)
    assert 28.0 < np.degrees(np.abs(np.diff(swing[:, 2]))).max() < 30.0
    assert abs(swing[24, 2]) < 1e-9
    with pytest.raises(InputError, match="half a turn"):
        replace(plain, turn=4.0)
    with pytest.raises(InputError, match="one of survey"):
        replace(plan("floodgate", "paper18"), turn=0.1)
