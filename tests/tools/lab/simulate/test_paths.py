"""Simulated trajectories: clearance, loops, lanes, and the rows of Table 1."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.plan import TABLE1_SENSOR, plan, table1_pair
from sonarmap.tools.lab.simulate.routes import LAWNMOWER_PATHS, gate_path, lawnmower_path, survey_path
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene, surface_distance
from sonarmap.tools.lab.simulate.sensing.sensors import ECLIPSE, SONAR_3D15, cast
from sonarmap.tools.lab.simulate.simulation import TRAJECTORIES
from sonarmap.tools.lab.simulate.smooth_path import lane_path, lanes
from sonarmap.tools.lab.simulate.trajectories import (
    lawnmower,
    loop,
    paper18,
    survey,
    table1,
    table1_transform,
)
from sonarmap.tools.lab.simulate.viewpoints import overlap

SPHERE = np.random.default_rng(0).standard_normal((300, 3))
SPHERE /= np.linalg.norm(SPHERE, axis=1, keepdims=True)
# Least distance of a path from the scene, for heave and the mount [m in a scene of 256 m]
CLEARANCE = 2.5


def _clearance(scene: str, seed: int, path) -> float:
    world = build_scene(scene, seed)
    places, _ = path.at(np.linspace(0, path.length, 80))
    assert not world.is_solid(places).any()
    origins, directions = np.repeat(places, len(SPHERE), axis=0), np.tile(SPHERE, (len(places), 1))
    return float(world.intersect(origins, directions)[0].min())


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("scene", SCENE_KINDS)
@pytest.mark.parametrize("seed", [101])
def test_paths_keep_clear_of_the_scene(scene: str, seed: int):
    least = CLEARANCE * SCENE_KINDS[scene].scale
    assert _clearance(scene, seed, survey_path(scene, seed)) > least
    assert _clearance(scene, seed, lawnmower_path(scene, seed)) > least
    if scene == "floodgate":
        assert _clearance(scene, seed, gate_path()) > least


@pytest.mark.slow
@pytest.mark.parametrize("seed", [101])
@pytest.mark.parametrize("trajectory", ["survey", "lawnmower", "loop"])
def test_a_short_range_sensor_passes_near_enough_to_the_ship(trajectory: str, seed: int):
    settings = plan("ship", trajectory, "sonar3d15", seed)
    assert trajectory == "loop" or settings.spacing < 1.2
    assert settings.noise.sigma2 < 0.02
    route = lawnmower_path if trajectory == "lawnmower" else survey_path
    assert _clearance("ship", seed, route("ship", seed, SONAR_3D15.max_range)) > CLEARANCE
    poses = TRAJECTORIES[trajectory](settings).T_world_sensor
    scene = build_scene("ship", seed)
    for T in poses[:: max(1, len(poses) // 30)]:
        assert np.isfinite(cast(scene, SONAR_3D15, T).ranges).mean() > 0.05


def test_lanes_are_closed_and_head_along_the_path():
    path = lane_path(np.column_stack([lanes((-30, -20), (30, 20), 3, 2, east=True), np.full(9, -4.0)]), 3.0)
    distance = np.linspace(0, path.length, 4001)
    places, heading = path.at(distance)
    step = np.diff(places, axis=0)
    assert_allclose(places[0], places[-1], atol=1e-9)
    assert_allclose(np.linalg.norm(step, axis=1), path.length / 4000, rtol=0.05)
    off = np.angle(np.exp(1j * (np.arctan2(step[:, 1], step[:, 0]) - heading[:-1])))
    assert np.median(np.abs(off)) < 0.02
    turned = np.abs(np.angle(np.exp(1j * np.diff(heading))))
    # even a near reversal is spread over TURNING bends
    assert turned.max() < 1.1 * np.pi / (5 * 3.0) * path.length / 4000
    assert np.abs(places[:, 0]).max() <= 30
    assert_allclose(places[:, 2], -4.0)


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("scene", SCENE_KINDS)
def test_a_loop_ends_one_step_from_its_start(scene: str):
    places = loop(scene, 30, seed=7).T_world_sensor.translation
    step = np.linalg.norm(np.diff(np.concatenate([places, places[:1]])[:, :2], axis=0), axis=1)
    assert step[-1] < 1.3 * step[:-1].max()
    assert np.linalg.norm(places - places[0], axis=1).max() > 3 * step.max()


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("scene", LAWNMOWER_PATHS)
def test_a_long_lawnmower_crosses_its_own_path(scene: str):
    spacing = plan(scene, "lawnmower").spacing
    places = lawnmower(scene, 200, 3, spacing).T_world_sensor.translation
    apart = np.linalg.norm(places[:, None, :2] - places[None, :, :2], axis=2)
    later = np.abs(np.subtract.outer(np.arange(200), np.arange(200))) > 20
    assert ((apart < spacing) & later).any(axis=1).mean() > 0.3
    assert np.ptp(places[:, 0]) > 0.35 * SCENE_KINDS[scene].size[0]


def test_impossible_trajectories_are_refused():
    for bad in (
        lambda: paper18("floodgate", 19, 0, ECLIPSE),
        lambda: paper18("harbor", 3, 0, ECLIPSE),
        lambda: loop("pool", 2, 0),
        lambda: lawnmower("ship", 5, 0, spacing=-1.0),
        lambda: survey("pool", 5, 0, spacing=float("nan")),
        lambda: plan("floodgate", "table1", sensor="paper"),
        lambda: table1_transform(-1),
        lambda: table1_transform(13),
    ):
        with pytest.raises(InputError):
            bad()


FEW = replace(TABLE1_SENSOR, columns=64, rows=48)


LARGE = [name for name, kind in SCENE_KINDS.items() if kind.scale == 1.0]


@pytest.mark.parametrize("scene", LARGE)
@pytest.mark.parametrize("seed", range(1, 41, 20))
@pytest.mark.slow
def test_the_rig_of_table_1_is_free_in_every_large_scene(scene: str, seed: int):
    """Nothing is within 3 m of its positions, and each sees the bed."""
    world, poses = build_scene(scene, seed), table1(13).T_world_sensor
    assert surface_distance(world.mesh, poses.translation).min() > 3.0
    for pose in poses:
        assert np.isfinite(cast(world, FEW, pose).ranges).mean() > 0.15


def test_table_1_pairs_overlap_by_their_truth():
    """Without noise most of S1's points lie near the reference's; by the inverse transform they do not."""
    target, source, T_target_source = table1_pair(1, seed=5, sigma2=0.0)
    assert overlap(target.points, source.points, T_target_source) > 0.8
    assert overlap(target.points, source.points, T_target_source.inv()) < 0.5
    assert_allclose(T_target_source.rotation.as_euler("ZYX", degrees=True), (12, 2, 4), atol=1e-9)
