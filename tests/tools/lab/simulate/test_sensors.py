"""The simulated sonar: its fan, what it sees, and its noise."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.scenes.solids import box, merge
from sonarmap.tools.lab.simulate.sensing.noise import Noise, disturb
from sonarmap.tools.lab.simulate.sensing.sensors import ABSORPTION_DB, ECLIPSE, Echoes, bare, cast
from sonarmap.tools.lab.simulate.simulation import SimulationSettings, observe
from tests.samples.refusals import refuses
from tests.samples.scenes.simulated import COARSE

IDENTITY = RigidTransform.identity()
FAN = bare(ECLIPSE)


def loud(ranges: np.ndarray) -> Echoes:
    """Echoes of full strength from these ranges."""
    return Echoes(ranges, np.isfinite(ranges).astype(float))


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


def test_only_unhidden_surfaces_within_range_and_fan_are_seen():
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
    noisy = disturb(loud(ranges), FAN, Noise(sigma2=2.5), np.random.default_rng(7)).ranges
    off = noisy - ranges
    # the standard error of a variance over n samples is sqrt(2 / n): 0.7 %; four of them
    assert_allclose(off.var(axis=1), 2.5 * ranges[:, 0] / 120.0, rtol=0.03)
    assert_allclose(off.mean(axis=1), 0.0, atol=4 * np.sqrt(2.5 * 0.8 / 40000))


def test_outliers_and_dropouts_have_their_shares():
    ranges = np.full((200, 500), 40.0)
    ranges[:20] = np.inf
    noisy = disturb(loud(ranges), FAN, Noise(outliers=0.1, dropouts=0.2), np.random.default_rng(5)).ranges
    seen = np.isfinite(noisy)
    assert not seen[:20].any()
    assert_allclose(seen[20:].mean(), 0.8, atol=0.006)
    wild = noisy[seen][noisy[seen] != 40.0]
    assert_allclose(len(wild) / seen.sum(), 0.1, atol=0.005)
    assert wild.min() >= FAN.min_range
    assert wild.max() <= FAN.max_range
    assert_allclose(wild.mean(), 60.2, atol=1.5)


BAD_NOISE = {"sigma2": (-1.0, np.nan), "outliers": (1.0,), "speckle": (1.1,)}
BAD_SENSOR = {"edge_loss": -1.0, "absorption": np.nan, "max_range": 0.1}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, bad in BAD_NOISE.items() for value in bad])
def test_impossible_noise_is_refused(name: str, value: float):
    refuses(name, Noise, **{name: value})


@pytest.mark.parametrize(("name", "value"), BAD_SENSOR.items())
def test_an_impossible_sensor_is_refused(name: str, value: float):
    with pytest.raises(InputError, match="wanted fields of view" if name == "max_range" else name):
        replace(ECLIPSE, **{name: value})


def test_a_view_without_echoes_is_refused():
    settings = SimulationSettings(scene="harbor")
    refuses("sees nothing", observe, settings, RigidTransform.from_translation((0, 0, 4000.0)), 0, "lost")
