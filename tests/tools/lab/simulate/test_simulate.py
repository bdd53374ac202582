"""Simulations: surveys and pairs, one seed for the same bytes, and the folder that holds them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.poses.tum import read_tum
from sonarmap.tools.lab.simulate.folder import read_settings, write_simulation
from sonarmap.tools.lab.simulate.pairs.random_pairs import random_pair
from sonarmap.tools.lab.simulate.paths.trajectories import survey
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.overlap import mutual_overlap
from sonarmap.tools.lab.simulate.sensing.sensors import ECLIPSE, SENSORS, bare
from sonarmap.tools.lab.simulate.simulation import SimulationSettings, observe, settings_from_json, simulate
from tests.samples.simulated import COARSE, QUIET


@pytest.mark.slow
@pytest.mark.parametrize("name", ["floodgate", "harbor", "clutter"])
def test_neighbors_of_a_survey_share_enough_and_run_into_nothing(name: str):
    # the bare fan: the path is under test, not what a threshold leaves of the views along it
    simulation = simulate(SimulationSettings(scene=name, count=12, sensor=bare(ECLIPSE), noise=QUIET))
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
        ({"trajectory": "orbit"}, "survey, loop, lawnmower, paper18, table1"),
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


@pytest.mark.parametrize("change", [{"count": 0}, {"spacing": 0.0}, {"trajectory": "table1", "count": 15}])
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


@pytest.mark.parametrize("scene", SCENE_KINDS)
def test_a_random_pair_overlaps_as_wanted(scene: str):
    kind = SCENE_KINDS[scene]
    small = replace(SENSORS[kind.sensor], columns=128, rows=64)
    target, source, T_target_source = random_pair(3, (0.4, 0.7), QUIET, scene, small)
    assert 0.4 <= mutual_overlap(target.points, source.points, T_target_source, 2.0 * kind.scale) <= 0.7
    again = random_pair(3, (0.4, 0.7), QUIET, scene, small)
    assert_array_equal(again[1].points, source.points)
    noisy = random_pair(3, (0.4, 0.7), Noise(sigma2=1.0), scene, small)
    assert_array_equal(noisy[2].as_matrix(), T_target_source.as_matrix())
