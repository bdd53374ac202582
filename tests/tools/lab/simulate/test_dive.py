"""Several dives over one scene: the same surface and path, other waves and noise."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.routes import lawnmower_path
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene, surface_distance
from sonarmap.tools.lab.simulate.simulation import TRAJECTORIES, SimulationSettings, simulate
from sonarmap.tools.lab.simulate.trajectories import lawnmower, start_of
from tests.samples.refusals import refuses
from tests.samples.scenes.simulated import COARSE

SETTINGS = SimulationSettings(trajectory="lawnmower", count=3, sensor=COARSE, seed=14)


def test_dives_begin_far_apart_and_the_first_at_the_start() -> None:
    starts = np.array([start_of(300.0, dive) for dive in range(1, 6)])
    assert starts[0] == 0.0
    apart = np.abs(starts[:, None] - starts)[np.triu_indices(5, 1)]
    assert np.minimum(apart, 300 - apart).min() > 300 / 10


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("scene", SCENE_KINDS)
def test_a_second_dive_follows_the_same_path(scene: str) -> None:
    settings = plan(scene, "lawnmower", seed=14)
    path, scale = lawnmower_path(scene, 14), SCENE_KINDS[scene].scale
    line, _ = path.at(np.linspace(0, path.length, 6000))
    places = TRAJECTORIES["lawnmower"](replace(settings, dive=2)).T_world_sensor.translation
    off = np.linalg.norm(places[:, None, :2] - line[None, :, :2], axis=2).min(axis=1)
    assert off.max() < 1.55 * scale
    assert np.median(off) > 0.1 * scale


def test_a_second_dive_has_the_same_scene_with_other_waves_and_noise() -> None:
    first, second = simulate(SETTINGS), simulate(replace(SETTINGS, dive=2))
    assert_array_equal(first.truth.stamps, second.truth.stamps)
    moved = first.truth.T_world_sensor.translation - second.truth.T_world_sensor.translation
    assert np.linalg.norm(moved, axis=1).min() > 5
    mesh = build_scene("floodgate", 14).mesh
    for simulation in (first, second):
        points = simulation.truth.T_world_sensor[0].apply(simulation.scans[0].points.astype(float))
        assert np.median(surface_distance(mesh, points)) < 0.5
    waves = [lawnmower("floodgate", 30, 14, dive=dive).T_world_sensor.rotation.as_euler("ZYX")[:, 2] for dive in (1, 2)]
    assert abs(np.corrcoef(waves)[0, 1]) < 0.9


@pytest.mark.parametrize(
    "change", [{"dive": 0}, {"dive": 2, "trajectory": "paper18"}, {"dive": 2, "trajectory": "table1"}]
)
def test_an_impossible_dive_is_refused(change: dict) -> None:
    refuses("dive", replace, SETTINGS, **change)
