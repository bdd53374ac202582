"""Fans of rays: which echo a beam picks, what is heard, where the points are placed; and how vehicles wander."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.kinds.sweep import (
    Fan,
    Returns,
    Sweep,
    meet,
    pick,
    true_points,
    walk,
    wobble,
    write_scan,
)
from sonarmap.tools.lab.simulate.kinds.water import Water
from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.sensing.sensors import Sensor
from sonarmap.tools.lab.simulate.shapes.solids import box
from tests.samples.simulated import QUIET

SENSOR = Sensor("test", 1.0, 1.0, 2, 2, 0.5, 50.0, absorption=0.0, threshold=0.01)
AHEAD = np.array((1.0, 0.0, 0.0))


def _fan(angles: tuple[float, ...], gains: tuple[float, ...] | None = None) -> Fan:
    """One beam ahead whose rays rise by some angles [rad]."""
    rays = np.array([(np.cos(angle), 0.0, np.sin(angle)) for angle in angles])
    return Fan(SENSOR, AHEAD[None], rays[None], np.array(gains or (1.0,) * len(angles)))


def _still(place: tuple[float, float, float], count: int = 1) -> Sweep:
    here = RigidTransform.from_components(np.zeros((count, 3)), Rotation.from_euler("z", np.zeros((count, 1))))
    return Sweep(RigidTransform.from_translation(place), here, here)


def _picked(ranges: list[float], strengths: list[float], cell: float = 0.0, share: float = 1.0) -> int:
    returns = pick(_fan((0.0,) * len(ranges)), np.array([[ranges]]), np.array([[strengths]]), cell, share)
    return int(returns.rays[0, 0])


def test_a_beam_picks_the_strongest_the_densest_or_the_first():
    ranges, strengths = [9.0, 5.0, 9.1, 3.0], [0.30, 0.50, 0.25, 0.20]
    assert _picked(ranges, strengths) == 1
    assert _picked(ranges, strengths, cell=0.2) == 0
    assert _picked(ranges, strengths, cell=0.2, share=0.85) == 1
    assert _picked(ranges, strengths, cell=0.2, share=0.3) == 3


def test_a_beam_below_the_threshold_brings_nothing_back():
    fan = _fan((0.0, 0.0))
    returns = pick(fan, np.array([[[4.0, np.inf]], [[4.0, 7.0]]]), np.array([[[0.009, 0.0]], [[0.009, 0.02]]]))
    assert_array_equal(returns.ranges[:, 0], (np.inf, 7.0))
    assert_array_equal(returns.strengths[:, 0], (0.0, 0.02))


def test_what_stands_above_the_water_is_not_heard():
    """A wall at x = 10 from 6 m under the surface to 6 m above it, from 1 m under it."""
    scene = Scene("floodgate", box((10.5, 0.0, 0.0), (1.0, 40.0, 12.0)))
    fan = _fan((-0.3, 0.0, 0.3), (1.0, 1.0, 0.5))
    ranges, strengths = meet(scene, fan, _still((0.0, 0.0, -1.0)).T_world_ping)
    assert_allclose(ranges[0, 0], (10 / np.cos(0.3), 10.0, np.inf))
    assert_allclose(strengths[0, 0], (np.cos(0.3) ** 2, 1.0, 0.0))


def test_points_are_placed_where_the_vehicle_believed_and_came_from_where_it_was():
    truly = RigidTransform.from_components([[0, 0, 0], [1, 2, 3]], Rotation.from_euler("z", [[0.0], [np.pi / 2]]))
    believed = RigidTransform.from_components([[0, 0, 0], [1, 2.5, 3]], Rotation.from_euler("z", [[0.0], [0.0]]))
    sweep = Sweep(RigidTransform.from_translation((7.0, 8.0, -9.0)), truly, believed)
    fan = _fan((0.0, np.pi / 2))
    returns = Returns(np.array([[4.0], [6.0]]), np.array([[1.0], [0.5]]), np.array([[1], [0]]))
    assert_allclose(true_points(fan, sweep, returns), ((0, 0, 4), (1, 8, 3)), atol=1e-12)
    scan = write_scan(fan, sweep, returns, QUIET, np.random.default_rng(1), "source")
    assert_allclose(scan.points, ((4, 0, 0), (7, 2.5, 3)), atol=1e-6)
    assert scan.viewpoints is not None
    assert_allclose(scan.viewpoints, ((0, 0, 0), (1, 2.5, 3)))
    assert_allclose(sweep.T_world_ping.translation, ((7, 8, -9), (8, 10, -6)))


def test_a_sweep_that_hears_nothing_is_refused():
    nothing = Returns(np.array([[np.inf]]), np.array([[0.0]]), np.array([[0]]))
    with pytest.raises(InputError, match="no beam"):
        write_scan(_fan((0.0,)), _still((0, 0, 0)), nothing, QUIET, np.random.default_rng(1), "source")


def test_a_walk_starts_in_the_middle_and_ends_about_its_sigma_away():
    walks = np.array([walk(101, (0.3, 2.0), np.random.default_rng(seed)) for seed in range(400)])
    assert_array_equal(walks[:, 50], 0.0)
    assert_allclose(walks[:, [0, -1]].std(axis=(0, 1)), (0.3, 2.0), rtol=0.15)
    # half as far in time: less by the root of two
    assert_allclose(walks[:, [25, 75]].std(axis=(0, 1)), np.array((0.3, 2.0)) / np.sqrt(2), rtol=0.15)


def test_a_wobble_has_its_sigma_everywhere_and_is_alike_over_its_width():
    wobbles = np.array([wobble(200, (0.1,), 5.0, np.random.default_rng(seed))[:, 0] for seed in range(300)])
    assert_allclose(wobbles.std(axis=0), 0.1, rtol=0.25)
    assert np.corrcoef(wobbles[:, 50], wobbles[:, 52])[0, 1] > 0.8
    assert abs(np.corrcoef(wobbles[:, 50], wobbles[:, 80])[0, 1]) < 0.2


def test_a_scenes_end_is_noticed_where_its_bed_would_go_on():
    bed = Scene("floodgate", box((0.0, 0.0, -21.0), (256.0, 256.0, 2.0)))
    water = Water(bed)
    assert water.bed == pytest.approx(-20.0)
    fan = _fan((-0.8,))
    for east, ends in ((0.0, False), (100.0, False), (115.0, True)):
        pings = _still((east, 0.0, -2.0)).T_world_ping
        ranges, _ = meet(bed, fan, pings)
        assert water.ends(fan, pings, ranges[..., 0]) == ends


def test_a_way_through_a_wall_is_not_free():
    water = Water(Scene("floodgate", box((10.0, 0.0, -5.0), (1.0, 8.0, 10.0))))
    assert not water.is_way_free(np.array(((0.0, 0.0, -2.0), (5.0, 0.0, -2.0), (20.0, 0.0, -2.0))))
    assert water.is_way_free(np.array(((0.0, 0.0, -2.0), (5.0, 9.0, -2.0), (20.0, 9.0, -2.0))))
    assert not water.is_free(np.array(((10.0, 0.0, -2.0),)))
    assert not water.is_free(np.array(((0.0, 0.0, 0.5),)))
    assert water.is_free(np.array(((0.0, 0.0, -2.0),)))
