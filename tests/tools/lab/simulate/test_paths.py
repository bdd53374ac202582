"""Where the sensor is carried: clear of everything, round and back again, and as far apart as an overlap allows."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.paths.routes import LAWNMOWER_PATHS, gate_path, lawnmower_path, survey_path
from sonarmap.tools.lab.simulate.paths.smooth_path import lane_path, lanes
from sonarmap.tools.lab.simulate.paths.stations import paper18
from sonarmap.tools.lab.simulate.paths.trajectories import lawnmower, loop, survey
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.floodgate import PIERS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.overlap import mutual_overlap, shared_view, visible_points
from sonarmap.tools.lab.simulate.sensing.sensors import ECLIPSE, SONAR_3D15, cast
from sonarmap.tools.lab.simulate.simulation import TRAJECTORIES

SPHERE = np.random.default_rng(0).standard_normal((300, 3))
SPHERE /= np.linalg.norm(SPHERE, axis=1, keepdims=True)
# Nearest thing to a path that is allowed: heave, and what the sensor hangs on [m in a scene of 256 m]
CLEARANCE = 2.5


def _clearance(scene: str, seed: int, path) -> float:
    world = build_scene(scene, seed)
    places, _ = path.at(np.linspace(0, path.length, 80))
    assert not world.is_solid(places).any()
    origins, directions = np.repeat(places, len(SPHERE), axis=0), np.tile(SPHERE, (len(places), 1))
    return float(world.intersect(origins, directions)[0].min())


@pytest.mark.parametrize("scene", SCENE_KINDS)
@pytest.mark.parametrize("seed", [101, 202])
def test_paths_keep_clear_of_everything(scene: str, seed: int):
    least = CLEARANCE * SCENE_KINDS[scene].scale
    assert _clearance(scene, seed, survey_path(scene, seed)) > least
    assert _clearance(scene, seed, lawnmower_path(scene, seed)) > least
    if scene == "floodgate":
        assert _clearance(scene, seed, gate_path()) > least


@pytest.mark.parametrize("seed", [101, 202])
@pytest.mark.parametrize("trajectory", ["survey", "lawnmower", "loop"])
def test_a_sensor_of_short_range_is_carried_near_enough_to_the_ship(trajectory: str, seed: int):
    settings = plan("ship", trajectory, "sonar3d15", seed)
    assert trajectory == "loop" or settings.spacing < 1.2
    assert settings.noise.sigma2 < 0.02
    route = lawnmower_path if trajectory == "lawnmower" else survey_path
    assert _clearance("ship", seed, route("ship", seed, SONAR_3D15.max_range)) > CLEARANCE
    poses = TRAJECTORIES[trajectory](settings).T_world_sensor
    scene = build_scene("ship", seed)
    for T in poses[:: max(1, len(poses) // 30)]:
        assert np.isfinite(cast(scene, SONAR_3D15, T).ranges).mean() > 0.05


def test_lanes_look_where_they_go_and_close():
    path = lane_path(np.column_stack([lanes((-30, -20), (30, 20), 3, 2, east=True), np.full(9, -4.0)]), 3.0)
    way = np.linspace(0, path.length, 4001)
    places, heading = path.at(way)
    step = np.diff(places, axis=0)
    assert_allclose(places[0], places[-1], atol=1e-9)
    assert_allclose(np.linalg.norm(step, axis=1), path.length / 4000, rtol=0.05)
    off = np.angle(np.exp(1j * (np.arctan2(step[:, 1], step[:, 0]) - heading[:-1])))
    assert np.median(np.abs(off)) < 0.02
    turned = np.abs(np.angle(np.exp(1j * np.diff(heading))))
    # even where it all but turns back it does so over TURNING bends
    assert turned.max() < 1.1 * np.pi / (5 * 3.0) * path.length / 4000
    assert np.abs(places[:, 0]).max() <= 30
    assert_allclose(places[:, 2], -4.0)


@pytest.mark.parametrize("scene", SCENE_KINDS)
def test_a_loop_ends_one_step_from_its_start(scene: str):
    places = loop(scene, 30, seed=7).T_world_sensor.translation
    step = np.linalg.norm(np.diff(np.concatenate([places, places[:1]])[:, :2], axis=0), axis=1)
    assert step[-1] < 1.3 * step[:-1].max()
    assert np.linalg.norm(places - places[0], axis=1).max() > 3 * step.max()


@pytest.mark.parametrize("scene", LAWNMOWER_PATHS)
def test_a_long_lawnmower_crosses_its_own_way(scene: str):
    spacing = plan(scene, "lawnmower").spacing
    places = lawnmower(scene, 200, 3, spacing).T_world_sensor.translation
    apart = np.linalg.norm(places[:, None, :2] - places[None, :, :2], axis=2)
    later = np.abs(np.subtract.outer(np.arange(200), np.arange(200))) > 20
    assert ((apart < spacing) & later).any(axis=1).mean() > 0.3
    assert np.ptp(places[:, 0]) > 0.35 * SCENE_KINDS[scene].size[0]


@pytest.mark.parametrize("scene", ["harbor", "pool"])
def test_neighbors_on_a_lawnmowers_turns_have_a_view_in_common(scene: str):
    settings = plan(scene, "lawnmower", seed=71)
    world, coarse = build_scene(scene, 71), replace(settings.sensor, columns=48, rows=32)
    poses = TRAJECTORIES["lawnmower"](settings).T_world_sensor
    shares = [shared_view(world, coarse, poses[k], poses[k + 1]) for k in range(len(poses) - 1)]
    assert min(shares) > 0.2
    assert np.mean(np.array(shares) > 0.4) > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("seed", [301, 302])
def test_the_papers_survey_overlaps_by_90_to_50_percent_and_covers_the_gate(seed: int):
    """Seeds that the path and its shares were not chosen on."""
    world = build_scene("floodgate", seed)
    poses = paper18("floodgate", 18, seed, ECLIPSE).T_world_sensor
    seen = [visible_points(world, ECLIPSE, pose) for pose in poses]
    view = [shared_view(world, ECLIPSE, poses[k], poses[k + 1]) for k in range(17)]
    near = [mutual_overlap(seen[k], seen[k + 1], RigidTransform.identity()) for k in range(17)]
    for shares in (view, near):
        assert 0.45 <= min(shares) <= 0.65
        assert 0.8 <= max(shares) <= 0.97
    points = np.concatenate(seen)
    assert points[:, 1].min() < -90
    assert points[:, 1].max() > 90
    marks = [*((18.0, y, 14.0) for y in PIERS), (-38, 26, 10.0), (-24, 52, 10.0), (-20, 40, 10.0), (-17, 66, 10.0)]
    high = points[points[:, 2] > -12]
    for x, y, reach in marks:
        assert (np.hypot(high[:, 0] - x, high[:, 1] - y) < reach).sum() > 300


def test_trajectories_that_cannot_be_are_refused():
    for bad in (
        lambda: paper18("floodgate", 19, 0, ECLIPSE),
        lambda: paper18("floodgate", 0, 0, ECLIPSE),
        lambda: paper18("harbor", 3, 0, ECLIPSE),
        lambda: loop("pool", 2, 0),
        lambda: lawnmower("ship", 5, 0, spacing=-1.0),
        lambda: lawnmower("ship", 0, 0),
        lambda: survey("moon", 5, 0),
        lambda: survey("pool", 5, 0, spacing=float("nan")),
        lambda: plan("pool", sensor="radar"),
        lambda: plan("floodgate", "table1", sensor="paper"),
    ):
        with pytest.raises(InputError):
            bad()


def test_a_plan_suits_the_scene():
    pool = plan("pool", "lawnmower")
    assert (pool.sensor.name, pool.count) == ("sonar3d15", 200)
    assert_allclose(pool.spacing, 9 * 25 / 256)
    assert_allclose(np.sqrt(pool.noise.sigma2), 15 / 120)
    gate = plan("floodgate")
    assert (gate.sensor.name, gate.count, gate.spacing, gate.noise.sigma2) == ("eclipse", 12, 9.0, 1.0)
    assert plan("floodgate", "paper18").count == 18
    ring = plan("manifold", "loop")
    places = TRAJECTORIES["loop"](ring).T_world_sensor.translation
    step = np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1)
    assert step.max() < 9 * 48 / 256 + 1e-6
