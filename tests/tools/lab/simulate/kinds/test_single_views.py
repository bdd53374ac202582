"""Distorted and moving views: true but for what the kind says, and that of its size."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.simulate.kinds.draws import SIGMA2, noise_of, observer_of
from sonarmap.tools.lab.simulate.kinds.single_view import (
    SCAN_TIME,
    SPEED,
    TURN,
    Motion,
    Shot,
    distorted_scan,
    draw_motion,
    scaled_scan,
    scan_in_motion,
    shifted_scan,
)
from sonarmap.tools.lab.simulate.pairs.viewpoints import Observer, View, first_view
from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.sensors import ECLIPSE, SONAR_3D15, Sensor, cast
from sonarmap.tools.lab.simulate.shapes.solids import box
from sonarmap.tools.lab.simulate.shapes.surface import surface_distance
from tests.samples.simulated import QUIET

FEW = Sensor("few", np.deg2rad(60), np.deg2rad(40), 31, 21, 0.1, 40.0)


def _shot(scene: str = "shallow", noise: Noise = QUIET, seed: int = 3) -> Shot:
    observer = observer_of(scene, 9)
    few = Observer(observer.world, replace(observer.sensor, columns=64, rows=32))
    view = first_view(few, 0.15, np.random.default_rng(2))
    return Shot(few, view, noise, np.random.default_rng(seed), np.random.default_rng(1), "source")


def _ranges(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points.astype(np.float64), axis=1)


@pytest.mark.parametrize("scene", ["shallow", "rubble", "flatbed"])
def test_without_distortion_the_points_lie_on_the_scenes_surface(scene: str):
    shot = _shot(scene)
    scan = distorted_scan(shot, lambda ranges: ranges)
    placed = shot.view.T_world_sensor.apply(scan.points.astype(np.float64))
    assert surface_distance(shot.observer.world.mesh, placed).max() < 1e-4
    assert (scan.name, scan.stamp, scan.prior) == ("source", 1.0, None)


def test_a_wrong_sound_speed_scales_all_ranges_alike_by_up_to_two_percent():
    true = _ranges(_shot().view.points)
    factors = []
    for seed in range(30):
        measured = _ranges(scaled_scan(_shot(seed=seed)).points)
        factor = measured.min() / true.min()
        assert_allclose(measured, (factor * true)[factor * true <= SONAR_3D15.max_range], rtol=1e-5)
        factors.append(factor)
    assert 0.98 - 1e-6 < min(factors) < 0.985
    assert 1.015 < max(factors) < 1.02 + 1e-6


def test_a_bias_shifts_all_ranges_alike_by_up_to_a_hundredth_of_the_greatest():
    true = _ranges(_shot().view.points)
    shifts = []
    for seed in range(30):
        measured = _ranges(shifted_scan(_shot(seed=seed)).points)
        shift = measured.min() - true.min()
        assert_allclose(measured, (true + shift)[true + shift <= SONAR_3D15.max_range], atol=1e-4)
        shifts.append(shift)
    assert -0.15 - 1e-4 < min(shifts) < -0.11
    assert 0.11 < max(shifts) < 0.15 + 1e-4


def test_ghosts_are_distorted_as_everything_else_is():
    noisy = Noise(ghosts=0.5)
    plain = distorted_scan(_shot("rubble", noisy), lambda ranges: ranges)
    scaled = distorted_scan(_shot("rubble", noisy), lambda ranges: 0.5 * ranges)
    assert_allclose(_ranges(scaled.points), 0.5 * _ranges(plain.points), rtol=1e-5)
    assert len(plain.points) < 1.1 * len(distorted_scan(_shot("rubble"), lambda ranges: ranges).points)


def _wall_shot() -> Shot:
    """Before an upright wall 10 m ahead."""
    observer = Observer(Scene("wall", box((10.5, 0, -20), (1.0, 90.0, 90.0))), FEW)
    pose = RigidTransform.from_translation((0.0, 0.0, -20.0))
    view = View(pose, cast(observer.world, FEW, pose), np.empty((0, 3)))
    return Shot(observer, view, QUIET, np.random.default_rng(0), np.random.default_rng(0), "target")


def test_a_sensor_at_rest_measures_what_a_still_one_does():
    shot = _wall_shot()
    scan = scan_in_motion(shot, Motion(np.zeros(3), np.zeros(3), 1.0))
    assert_array_equal(scan.points, distorted_scan(shot, lambda ranges: ranges).points)


def test_a_sensor_that_goes_ahead_sees_the_wall_lean():
    """At 0.8 m/s over 0.5 s: the lowest row, measured first, from 0.2 m farther off, the highest from 0.2 m nearer."""
    shot = _wall_shot()
    scan = scan_in_motion(shot, Motion(np.array((0.8, 0.3, 0.0)), np.zeros(3), 0.5))
    ahead = scan.points.reshape(FEW.rows, FEW.columns, 3)[..., 0]
    assert_allclose(ahead, np.broadcast_to(10.0 - np.linspace(-0.2, 0.2, FEW.rows)[:, None], ahead.shape), atol=1e-4)


def test_a_sensor_that_turns_sees_the_wall_twisted():
    """At 6 degrees a second over a second to the left: the last row is seen as if the wall had turned to the right."""
    shot = _wall_shot()
    scan = scan_in_motion(shot, Motion(np.zeros(3), np.array((0.0, 0.0, np.deg2rad(6.0))), 1.0))
    rows = scan.points.reshape(FEW.rows, FEW.columns, 3)
    for row, turned in ((0, -3.0), (FEW.rows // 2, 0.0), (-1, 3.0)):
        back = Rotation.from_euler("z", turned, degrees=True).apply(rows[row].astype(np.float64))
        assert_allclose(back[:, 0], 10.0, atol=1e-4)


def test_motions_stay_below_their_bounds_and_come_near_them():
    motions = [draw_motion(ECLIPSE, np.random.default_rng(seed)) for seed in range(300)]
    speeds = [np.linalg.norm(motion.velocity) for motion in motions]
    turns = [abs(motion.turning[2]) for motion in motions]
    assert 0.9 * SPEED < max(speeds) <= SPEED
    assert 0.9 * TURN < max(turns) <= TURN
    assert np.mean([abs(motion.velocity[0]) > abs(motion.velocity[1]) for motion in motions]) > 0.7
    assert motions[0].seconds == SCAN_TIME[1]
    assert draw_motion(SONAR_3D15, np.random.default_rng(0)).seconds == SCAN_TIME[0]


def test_every_scene_meets_every_overlap_with_every_noise():
    for kind, count in (("moving", 11), ("sonar3d15", 5)):
        met = {
            (number % count, number // count % 3, noise_of(kind, number, "harbor").sigma2)
            for number in range(9 * count)
        }
        assert len(met) == 9 * count
        assert {sigma2 for _, _, sigma2 in met} == set(SIGMA2)
    assert_allclose(noise_of("moving", 0, "rubble").sigma2, 0.25 * (40 / 256) ** 2)
    assert_allclose(noise_of("moving", 0, "shallow").sigma2, 0.25 / 16 * (40 / 256) ** 2)
