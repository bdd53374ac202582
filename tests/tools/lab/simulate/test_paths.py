"""Where the sensor goes: clear of everything, round and back again, and the rows of Table 1."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.paths.routes import LAWNMOWER_PATHS, gate_path, lawnmower_path, survey_path
from sonarmap.tools.lab.simulate.paths.smooth_path import lane_path, lanes
from sonarmap.tools.lab.simulate.paths.stations import paper18
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_RIG, lawnmower, loop, survey, table1, table1_transform
from sonarmap.tools.lab.simulate.plan import TABLE1_SENSOR, louder, plan, table1_pair, table1_settings
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.floodgate import PIERS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.overlap import mutual_overlap, overlap, shared_view, visible_points
from sonarmap.tools.lab.simulate.sensing.sensors import ECLIPSE, SONAR_3D15, cast
from sonarmap.tools.lab.simulate.shapes.surface import surface_distance
from sonarmap.tools.lab.simulate.simulation import TRAJECTORIES, simulate
from tests.samples.refusals import refuses

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


@pytest.mark.quick_cases(6)
@pytest.mark.parametrize("scene", SCENE_KINDS)
@pytest.mark.parametrize("seed", [101, 202])
def test_paths_keep_clear_of_everything(scene: str, seed: int):
    least = CLEARANCE * SCENE_KINDS[scene].scale
    assert _clearance(scene, seed, survey_path(scene, seed)) > least
    assert _clearance(scene, seed, lawnmower_path(scene, seed)) > least
    if scene == "floodgate":
        assert _clearance(scene, seed, gate_path()) > least


@pytest.mark.quick_cases(1)
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


@pytest.mark.slow
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


FEW = replace(TABLE1_SENSOR, columns=64, rows=48)


def test_table_1_moves_and_turns_as_the_paper_says():
    """S8: 108, 72 and 36 voxels, yaw 54, roll 18, pitch 9 degrees, R = Rz Ry Rx written out."""
    transform = table1_transform(8)
    assert_allclose(transform.translation, (36, 72, 108))
    (cy, cp, cr), (sy, sp, sr) = (f(np.deg2rad((54, 9, 18))) for f in (np.cos, np.sin))
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    assert_allclose(transform.rotation.as_matrix(), about_z @ about_y @ about_x, atol=1e-12)
    assert_allclose(table1_transform(0).translation, (4, 8, 12))
    for index in (-1, 13):
        refuses("S0 to S9", table1_transform, index)


def test_table_1_goes_on_with_the_same_steps_to_s12():
    transform = table1_transform(12)
    assert_allclose(transform.translation, (52, 104, 156))
    assert_allclose(transform.rotation.as_euler("ZYX", degrees=True), (78, 13, 26), atol=1e-9)
    assert len(table1()) == 11
    assert len(table1(13)) == 14
    assert_array_equal(table1(13).T_world_sensor[:11].as_matrix(), table1().T_world_sensor.as_matrix())
    target, source, T_target_source = table1_pair(12, seed=5, sigma2=0.0)
    assert 0.02 < overlap(target.points, source.points, T_target_source) < 0.2
    assert overlap(target.points, source.points, table1_pair(11, 5, 0.0)[2]) < 0.02


LARGE = [name for name, kind in SCENE_KINDS.items() if kind.scale == 1.0]


@pytest.mark.slow
@pytest.mark.parametrize("scene", LARGE)
def test_the_rig_of_table_1_is_out_of_every_solid_of_forty_seeds(scene: str):
    places = table1(13).T_world_sensor.translation
    for seed in range(1, 41):
        assert not build_scene(scene, seed).is_solid(places).any()


@pytest.mark.parametrize("scene", LARGE)
@pytest.mark.parametrize("seed", range(1, 41, 13))
@pytest.mark.slow
def test_the_rig_of_table_1_is_free_in_every_large_scene(scene: str, seed: int):
    """Nothing within 3 m of any of its places; and the bed is in sight of each."""
    world, poses = build_scene(scene, seed), table1(13).T_world_sensor
    assert surface_distance(world.mesh, poses.translation).min() > 3.0
    for pose in poses:
        assert np.isfinite(cast(world, FEW, pose).ranges).mean() > 0.15


def test_table_1_pairs_obey_their_truth():
    """Without noise most of S1's points lie near the reference's; turned the wrong way they do not."""
    target, source, T_target_source = table1_pair(1, seed=5, sigma2=0.0)
    assert overlap(target.points, source.points, T_target_source) > 0.8
    assert overlap(target.points, source.points, T_target_source.inv()) < 0.5
    center = -np.array(TABLE1_RIG)
    about_center = RigidTransform.from_translation(-center) * T_target_source * RigidTransform.from_translation(center)
    assert_allclose(about_center.as_matrix(), table1_transform(1).as_matrix(), atol=1e-12)
    assert_allclose(T_target_source.rotation.as_euler("ZYX", degrees=True), (12, 2, 4), atol=1e-9)


@pytest.mark.slow
def test_table_1_overlap_falls_smoothly_to_a_small_share():
    pairs = [table1_pair(index, seed=0, sigma2=0.0) for index in range(10)]
    shares = [overlap(target.points, source.points, T_target_source) for target, source, T_target_source in pairs]
    steps = -np.diff(shares)
    assert shares[0] > 0.85
    assert 0.15 <= shares[8] <= 0.35
    assert shares[9] > 0.1
    assert (steps > 0.03).all()
    assert (steps < 0.13).all()


@pytest.mark.slow
def test_the_series_and_the_pair_are_the_same_scans():
    series = simulate(replace(table1_settings(seed=2, sigma2=1.0), count=4))
    target, source, T_target_source = table1_pair(2, seed=2, sigma2=1.0)
    assert_array_equal(series.scans[0].points, target.points)
    assert_array_equal(series.scans[3].points, source.points)
    poses = series.truth.T_world_sensor
    assert_allclose((poses[0].inv() * poses[3]).as_matrix(), T_target_source.as_matrix(), atol=1e-12)


def test_a_louder_path_has_more_noise_and_nothing_else() -> None:
    usual = plan("wreck", seed=3)
    loud = louder(usual, 2.0)
    assert loud.noise.sigma2 == 4 * usual.noise.sigma2 > 0
    assert replace(loud, noise=usual.noise) == usual
