"""The simulator: hand-computed hits of rays, the law of the noise, Table 1, one seed for the same bytes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform, Rotation

from kernels.errors import InputError
from tools.readers.tum import read_tum
from tools.simulate.folder import read_settings, write_simulation
from tools.simulate.noise import Noise, disturb
from tools.simulate.overlap import mutual_overlap, overlap
from tools.simulate.pairs import random_pair
from tools.simulate.scenes import SCENES, Scene, build_scene
from tools.simulate.sensors import ABSORPTION_DB, ECLIPSE, PAPER, SENSORS, Sensor, cast
from tools.simulate.series import TABLE1_RIG, table1_pair, table1_settings, table1_transform
from tools.simulate.simulation import SimulationSettings, observe, settings_from_json, simulate
from tools.simulate.solids import Mesh, box, cylinder, ellipsoid, height_field, merge, wall
from tools.simulate.trajectories import SURVEY_LOOPS, survey

COARSE = Sensor("coarse", np.deg2rad(90), np.deg2rad(60), 33, 21, 0.5, 60.0)
IDENTITY = RigidTransform.identity()
QUIET = Noise()


SLANT = np.array([10.0, 1.0, -2.0])
SLANT_LENGTH = float(np.linalg.norm(SLANT))


def _volume(mesh: Mesh) -> float:
    """Signed volume of a closed surface: positive where all triangles face outward."""
    corners = mesh.vertices[mesh.triangles]
    return float(np.linalg.det(corners).sum() / 6)


def test_a_box_is_hit_where_arithmetic_says():
    scene = Scene("box", box((11.0, 2.0, -1.0), (2.0, 4.0, 6.0)))
    origins = np.array([[0, 2, 0], [0, 2, 0], [11, -7, 1.5], [11, 2, 30], [0, 2, 0]], float)
    directions = np.array([[1, 0, 0], SLANT / SLANT_LENGTH, [0, 1, 0], [0, 0, -1], [-1, 0, 0]], float)
    ranges, sines = scene.intersect(origins, directions)
    assert_allclose(ranges, [10.0, SLANT_LENGTH, 7.0, 28.0, np.inf], rtol=1e-12)
    assert_allclose(sines, [1.0, 10 / SLANT_LENGTH, 1.0, 1.0, 0.0], rtol=1e-12)


def test_a_turned_box_is_hit_on_its_corner_edge():
    scene = Scene("box", box((10.0, 0.0, 0.0), (2.0, 2.0, 2.0), Rotation.from_euler("z", np.pi / 4)))
    ranges, sines = scene.intersect(np.array([[0.0, 0.1, 0.2]]), np.array([[1.0, 0.0, 0.0]]))
    assert_allclose(ranges, 10 - np.sqrt(2) + 0.1, rtol=1e-12)
    assert_allclose(sines, np.sqrt(0.5), rtol=1e-12)


@pytest.mark.parametrize(
    ("mesh", "volume", "tolerance"),
    [
        (box((3, -2, 5), (2, 3, 4), Rotation.from_euler("ZYX", (0.3, -0.2, 0.9))), 24.0, 1e-12),
        (cylinder((1, 2, -3), (4, 2, 1), 0.7, sides=96), np.pi * 0.49 * 5, 1e-3),
        (ellipsoid((0, 1, 2), (2, 3, 1.5), Rotation.from_euler("x", 0.4), rings=40), 4 / 3 * np.pi * 9, 1e-2),
        (wall([(0, 0), (10, 0)], 2.0, -3.0, 4.0), 12 * 2 * 7, 1e-12),
    ],
)
def test_solids_are_closed_and_face_outward(mesh: Mesh, volume: float, tolerance: float):
    assert_allclose(_volume(mesh), volume, rtol=tolerance)


def test_merging_keeps_every_solid():
    both = merge([box((0, 0, 0), (1, 1, 1)), box((5, 0, 0), (2, 2, 2))])
    assert_allclose(_volume(both), 9.0)


def test_a_height_field_is_seen_from_above_at_its_heights():
    x, y = np.array([0.0, 2.0, 5.0]), np.array([-1.0, 1.0])
    field = height_field(x, y, np.array([[0.0, 0.0], [4.0, 4.0], [4.0, 4.0]]))
    down = np.tile([0.0, 0.0, -1.0], (2, 1))
    ranges, sines = Scene("step", field).intersect(np.array([[1.0, 0.3, 20], [3.0, -0.4, 20]]), down)
    assert_allclose(ranges, [18.0, 16.0])
    assert_allclose(sines, [1 / np.sqrt(5), 1.0])


def test_the_fan_spans_the_field_of_view_right_to_left_and_up():
    directions = COARSE.directions()
    assert directions.shape == (21, 33, 3)
    assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, rtol=1e-12)
    assert_allclose(directions[10, 16], (1, 0, 0), atol=1e-12)
    azimuth = np.rad2deg(np.arctan2(directions[10, :, 1], directions[10, :, 0]))
    elevation = np.rad2deg(np.arcsin(directions[:, 16, 2]))
    assert_allclose(azimuth, np.linspace(-45, 45, 33), atol=1e-9)
    assert_allclose(elevation, np.linspace(-30, 30, 21), atol=1e-9)
    tilted = replace(COARSE, tilt=np.deg2rad(25)).directions()
    assert_allclose(tilted[10, 16], (np.cos(np.deg2rad(25)), 0, -np.sin(np.deg2rad(25))), atol=1e-12)


def test_a_cast_sees_the_wall_in_the_sensor_frame():
    """A wall 30 m east; the sensor stands off the origin, rolled and yawed: its points lie on the wall."""
    scene = Scene("wall", box((30.5, 0, 0), (1.0, 400.0, 400.0)))
    T_world_sensor = RigidTransform.from_components(
        (3.0, -7.0, 2.0), Rotation.from_euler("ZYX", np.deg2rad((20, -5, 8)))
    )
    echoes = cast(scene, COARSE, T_world_sensor)
    seen = np.isfinite(echoes.ranges)
    points = COARSE.directions()[seen] * echoes.ranges[seen][:, None]
    assert_allclose(T_world_sensor.apply(points)[:, 0], 30.0, atol=1e-9)
    middle = echoes.ranges[10, 16]
    sine = T_world_sensor.rotation.as_matrix()[0, 0]
    assert_allclose(middle, 27.0 / sine, rtol=1e-12)
    assert_allclose(echoes.strengths[10, 16], sine**2 * 10 ** (-0.2 * ABSORPTION_DB * middle), rtol=1e-12)


def test_only_what_is_near_enough_in_the_fan_and_not_hidden_is_seen():
    near = box((20.0, 0, 0), (2.0, 2.0, 2.0))
    hidden = box((30.0, 0, 0), (2.0, 1.0, 1.0))
    behind = box((-20.0, 0, 0), (2.0, 2.0, 2.0))
    far = box((90.0, 30.0, 0), (2.0, 2.0, 2.0))
    inside_minimum = box((0.3, 0, 0), (0.1, 0.1, 0.1))
    alone = cast(Scene("near", near), COARSE, IDENTITY)
    crowded = cast(Scene("all", merge([near, hidden, behind, far])), COARSE, IDENTITY)
    assert np.isfinite(alone.ranges).sum() >= 1
    assert_array_equal(alone.ranges, crowded.ranges)
    assert np.isinf(cast(Scene("close", inside_minimum), COARSE, IDENTITY).ranges).all()
    assert (crowded.strengths[np.isinf(crowded.ranges)] == 0).all()


def test_the_variance_of_the_range_is_proportional_to_the_range():
    ranges = np.repeat(np.array([[12.0], [48.0], [96.0]]), 40000, axis=1)
    noisy = disturb(ranges, ECLIPSE, Noise(sigma2=2.5), np.random.default_rng(7))
    off = noisy - ranges
    # the standard error of a variance over n samples is sqrt(2 / n): 0.7 %; four of them
    assert_allclose(off.var(axis=1), 2.5 * ranges[:, 0] / 120.0, rtol=0.03)
    assert_allclose(off.mean(axis=1), 0.0, atol=4 * np.sqrt(2.5 * 0.8 / 40000))


def test_noise_acts_along_the_beam():
    settings = SimulationSettings(sensor=replace(PAPER, columns=24, rows=18), noise=Noise(sigma2=2.0), seed=3)
    pose = RigidTransform.from_translation((-60.0, -20.0, 0.0))
    noisy = observe(settings, pose, 0, "noisy").points
    clean = observe(replace(settings, noise=QUIET), pose, 0, "clean").points
    assert len(noisy) == len(clean)
    assert np.linalg.norm(noisy - clean, axis=1).max() > 0.5
    cosine = (noisy * clean).sum(axis=1) / np.linalg.norm(noisy, axis=1) / np.linalg.norm(clean, axis=1)
    assert_allclose(cosine, 1.0, atol=1e-6)


def test_shares_of_outliers_and_dropouts_are_kept():
    ranges = np.full((200, 500), 40.0)
    ranges[:20] = np.inf
    noisy = disturb(ranges, ECLIPSE, Noise(outliers=0.1, dropouts=0.2), np.random.default_rng(5))
    seen = np.isfinite(noisy)
    assert not seen[:20].any()
    assert_allclose(seen[20:].mean(), 0.8, atol=0.006)
    wild = noisy[seen][noisy[seen] != 40.0]
    assert_allclose(len(wild) / seen.sum(), 0.1, atol=0.005)
    assert wild.min() >= ECLIPSE.min_range
    assert wild.max() <= ECLIPSE.max_range
    assert_allclose(wild.mean(), 60.2, atol=1.5)


@pytest.mark.parametrize("bad", [{"sigma2": -1.0}, {"sigma2": np.nan}, {"outliers": 1.0}, {"dropouts": -0.1}])
def test_impossible_noise_is_refused(bad: dict[str, float]):
    with pytest.raises(InputError, match=next(iter(bad))):
        Noise(**bad)


def test_an_impossible_sensor_is_refused():
    with pytest.raises(InputError, match="wanted fields of view"):
        replace(ECLIPSE, max_range=0.1)


def test_a_sensor_that_sees_nothing_says_so():
    settings = SimulationSettings(scene="harbor")
    with pytest.raises(InputError, match="sees nothing"):
        observe(settings, RigidTransform.from_translation((0, 0, 4000.0)), 0, "lost")


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
    for index in (-1, 10):
        with pytest.raises(InputError, match="S0 to S9"):
            table1_transform(index)


def test_table_1_pairs_obey_their_truth():
    """Without noise most of S1's points lie near the reference's; turned the wrong way they do not."""
    target, source, T_target_source = table1_pair(1, seed=5, sigma2=0.0)
    assert overlap(target.points, source.points, T_target_source) > 0.8
    assert overlap(target.points, source.points, T_target_source.inv()) < 0.5
    center = -np.array(TABLE1_RIG)
    about_center = RigidTransform.from_translation(-center) * T_target_source * RigidTransform.from_translation(center)
    assert_allclose(about_center.as_matrix(), table1_transform(1).as_matrix(), atol=1e-12)
    assert_allclose(T_target_source.rotation.as_euler("ZYX", degrees=True), (12, 2, 4), atol=1e-9)


def test_table_1_overlap_falls_smoothly_to_a_small_share():
    shares = []
    for index in range(10):
        target, source, T_target_source = table1_pair(index, seed=0, sigma2=0.0)
        shares.append(overlap(target.points, source.points, T_target_source))
    steps = -np.diff(shares)
    assert shares[0] > 0.85
    assert 0.15 <= shares[8] <= 0.35
    assert shares[9] > 0.1
    assert (steps > 0.03).all()
    assert (steps < 0.13).all()


def test_the_series_and_the_pair_are_the_same_scans():
    series = simulate(replace(table1_settings(seed=2, sigma2=1.0), count=4))
    target, source, T_target_source = table1_pair(2, seed=2, sigma2=1.0)
    assert_array_equal(series.scans[0].points, target.points)
    assert_array_equal(series.scans[3].points, source.points)
    poses = series.truth.T_world_sensor
    assert_allclose((poses[0].inv() * poses[3]).as_matrix(), T_target_source.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_its_seed(name: str):
    first, again, other = SCENES[name](4), SCENES[name](4), SCENES[name](5)
    assert_array_equal(first.vertices, again.vertices)
    assert_array_equal(first.triangles, again.triangles)
    assert len(first.triangles) > 10000
    assert not np.array_equal(first.vertices, other.vertices)
    across = np.cross(*np.moveaxis(np.diff(first.vertices[first.triangles], axis=1), 1, 0))
    assert (np.linalg.norm(across, axis=1) > 0).all()


@pytest.mark.parametrize("name", ["floodgate", "harbor"])
def test_a_bed_is_under_water_and_structures_rise_above_it(name: str):
    axis = np.linspace(-120, 120, 60)
    x, y = np.meshgrid(axis, axis)
    above = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 50.0)])
    ranges, _ = build_scene(name, 0).intersect(above, np.tile([0.0, 0.0, -1.0], (x.size, 1)))
    height = 50.0 - ranges
    assert np.isfinite(height).all()
    assert -25 < np.median(height) < -12
    assert height.max() > 5


@pytest.mark.slow
@pytest.mark.parametrize("name", SURVEY_LOOPS)
def test_neighbors_of_a_survey_share_enough_and_run_into_nothing(name: str):
    simulation = simulate(SimulationSettings(scene=name, count=12, noise=QUIET))
    poses, scans = simulation.truth.T_world_sensor, simulation.scans
    shares = [mutual_overlap(scans[k].points, scans[k + 1].points, poses[k].inv() * poses[k + 1]) for k in range(11)]
    assert min(shares) >= 0.5
    assert max(shares) <= 0.97
    assert min(np.linalg.norm(scan.points, axis=1).min() for scan in scans) > 4.0


def test_a_survey_moves_like_a_small_vessel_and_comes_back():
    truth = survey("floodgate", 60, seed=1)
    _, pitch, roll = truth.T_world_sensor.rotation.as_euler("ZYX", degrees=True).T
    assert 1 < np.abs(roll).max() < 6
    assert 0.5 < np.abs(pitch).max() < 4
    places = truth.T_world_sensor.translation
    step = np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1)
    assert (step <= 9.01).all()
    assert (step > 6).all()
    assert np.ptp(places[:, 2]) > 0.3
    assert np.linalg.norm(places[30:, :2] - places[0, :2], axis=1).min() < 9.0
    assert_array_equal(truth.stamps, np.arange(60.0))


def test_one_seed_gives_the_same_bytes(tmp_path):
    settings = SimulationSettings(count=2, sensor=SENSORS["sonar3d15"], seed=11)
    settings = replace(settings, sensor=replace(settings.sensor, max_range=80.0))
    first = write_simulation(simulate(settings), tmp_path / "a")
    again = write_simulation(simulate(read_settings(tmp_path / "a" / "description.json")), tmp_path / "b")
    assert [path.name for path in first] == ["scan_000.ply", "scan_001.ply", "truth.tum", "description.json"]
    for one, other in zip(first, again, strict=True):
        assert one.read_bytes() == other.read_bytes()
    other_seed = simulate(replace(settings, seed=12))
    assert not np.array_equal(other_seed.scans[0].points, simulate(settings).scans[0].points)


def test_scans_draw_their_noise_apart():
    settings = SimulationSettings(sensor=COARSE, noise=Noise(sigma2=1.0))
    pose = RigidTransform.from_translation((-60.0, -20.0, 0.0))
    assert not np.array_equal(observe(settings, pose, 0, "a").points, observe(settings, pose, 1, "b").points)


def test_the_written_truth_is_the_truth(tmp_path):
    simulation = simulate(SimulationSettings(count=3, sensor=COARSE))
    write_simulation(simulation, tmp_path)
    truth = read_tum(tmp_path / "truth.tum")
    assert_array_equal(truth.stamps, [scan.stamp for scan in simulation.scans])
    assert_allclose(truth.T_world_sensor.as_matrix(), simulation.truth.T_world_sensor.as_matrix(), atol=1e-14)
    described = json.loads((tmp_path / "description.json").read_text())
    assert [row["points"] for row in described["scans"]] == [len(scan.points) for scan in simulation.scans]


def test_a_folder_with_other_scans_is_left_alone(tmp_path):
    write_simulation(simulate(SimulationSettings(count=2, sensor=COARSE)), tmp_path)
    before = (tmp_path / "scan_000.ply").read_bytes()
    with pytest.raises(InputError, match=r"already holds scan_001\.ply"):
        write_simulation(simulate(SimulationSettings(count=1, sensor=COARSE, seed=9)), tmp_path)
    assert (tmp_path / "scan_000.ply").read_bytes() == before


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"scenery": "harbor"}, "scenery"),
        ({"scene": "moon"}, "floodgate, harbor, clutter"),
        ({"trajectory": "orbit"}, "survey, table1"),
        ({"noise": {"sigma2": -1}}, "wanted a variance"),
        ({"noise": {"sigma": 1}}, "sigma"),
        ({"sensor": {"name": "half"}}, r"sensor\.horizontal"),
        ({"count": "many"}, "count"),
        ({"seed": -1}, "seed"),
        ([], "settings"),
    ],
)
def test_settings_that_cannot_be_used_are_named(content: object, message: str):
    with pytest.raises(InputError, match=message):
        settings_from_json(content)


@pytest.mark.parametrize("change", [{"count": 0}, {"spacing": 0.0}, {"trajectory": "table1", "count": 12}])
def test_a_trajectory_that_cannot_be_is_refused(change: dict):
    with pytest.raises(InputError):
        simulate(replace(SimulationSettings(), **change))


@pytest.mark.parametrize("text", [None, "not json", "[]", "{}"])
def test_a_description_that_is_none_is_refused(tmp_path, text: str | None):
    path = tmp_path / "description.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=r"description\.json"):
        read_settings(path)


@pytest.mark.parametrize("scene", SCENES)
def test_a_random_pair_overlaps_as_wanted(scene: str):
    small = replace(ECLIPSE, columns=128, rows=96)
    target, source, T_target_source = random_pair(3, (0.4, 0.7), QUIET, scene, small)
    assert 0.4 <= mutual_overlap(target.points, source.points, T_target_source) <= 0.7
    again = random_pair(3, (0.4, 0.7), QUIET, scene, small)
    assert_array_equal(again[1].points, source.points)
    noisy = random_pair(3, (0.4, 0.7), Noise(sigma2=1.0), scene, small)
    assert_array_equal(noisy[2].as_matrix(), T_target_source.as_matrix())
