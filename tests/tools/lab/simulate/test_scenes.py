"""Scenes with a layout: sizes, solid and free places, and shared views."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.simulate.scenes.pool import LENGTH, WIDTH, pool_layout
from sonarmap.tools.lab.simulate.scenes.scene import Scene, build_scene
from sonarmap.tools.lab.simulate.scenes.solids import box, merge, tube
from sonarmap.tools.lab.simulate.sensing.sensors import SENSORS, Sensor, cast
from sonarmap.tools.lab.simulate.viewpoints import in_view, shared_view

DOWN = np.array([[0.0, 0.0, -1.0]])


def test_overlapping_solids_are_solid_inside_and_free_outside():
    scene = Scene("two", merge([box((0, 0, 0), (4, 4, 4)), box((1, 1, 1), (4, 4, 4))]))
    places = np.array([[0, 0, 0], [1, 1, 1], [2.5, 2.5, 2.5], [-1.5, 2.5, 0], [0, 0, -9], [0, 0, 9]], float)
    assert_array_equal(scene.is_solid(places), [True, True, True, False, False, False])


def test_a_straight_tube_is_a_cylinder_and_a_bent_one_follows_its_legs():
    pipe = tube([(0, 0, 0), (10, 0, 0)], 0.5, sides=96)
    ranges, _ = Scene("pipe", pipe).intersect(
        np.array([[4.0, 0.0, 7.0], [4.0, 0.3, 7.0], [4.0, 0.51, 7.0]]), DOWN.repeat(3, 0)
    )
    assert_allclose(ranges, [6.5, 6.6, np.inf], atol=1e-3)
    bent = Scene("bent", tube([(0, 0, 0), (10, 0, 0), (10, 8, 0)], 0.5, bend=2.0))
    places = np.array([[5, 0.0, 0], [10, 6, 0], [9.5, 0.5, 0], [10, 0, 0]])
    assert bent.is_solid(places).tolist() == [True, True, True, False]


@pytest.mark.parametrize("seed", [3])
def test_a_pool_has_the_depths_of_its_layout_and_nothing_is_outside_it(seed: int):
    layout, scene = pool_layout(seed), build_scene("pool", seed)
    assert (layout.depths[0], layout.depths[-1]) == (3.8, 1.2)
    x = np.linspace(-12.3, 12.3, 60)
    origins = np.column_stack([x, np.full(60, 5.9), np.full(60, -0.01)])
    ranges, _ = scene.intersect(origins, DOWN.repeat(60, 0))
    depth = -np.array([layout.floor(east) for east in x]) - 0.01
    # on the floor, whose breaks are up to a raster cell off, or on an object
    assert (ranges <= depth + 0.01).all()
    assert np.isclose(ranges, depth, atol=0.01).mean() > 0.5
    pose = RigidTransform.from_components((1.0, 0.5, -0.6), Rotation.from_euler("ZYX", (0.9, 0.1, 0.05)))
    for turn in range(4):
        around = pose * RigidTransform.from_rotation(Rotation.from_euler("z", turn * np.pi / 2))
        echoes = cast(scene, SENSORS["sonar3d15"], around)
        seen = np.isfinite(echoes.ranges)
        points = around.apply(SENSORS["sonar3d15"].directions()[seen] * echoes.ranges[seen][:, None])
        under = points[points[:, 2] < 0]
        assert (np.abs(under) <= (LENGTH / 2 + 1e-6, WIDTH / 2 + 1e-6, 4.06)).all()


def test_a_shared_view_is_in_both_fans_and_not_hidden():
    wall = box((10.5, 0, 0), (1.0, 60.0, 60.0))
    fan = Sensor("fan", np.deg2rad(90), np.deg2rad(40), 65, 33, 0.1, 40.0)
    here = RigidTransform.identity()
    # at half the distance: the wall is seen from -5 to 5 m instead of -10 to 10 m
    near = RigidTransform.from_translation((5.0, 0.0, 0.0))
    scene = Scene("wall", wall)
    assert shared_view(scene, fan, here, here) == 1.0
    points = np.array([[10.0, 9.9, 0.0], [10.0, 4.9, 0.0], [10.0, -5.1, 0.0], [10.0, 0.0, 2.5]])
    assert in_view(scene, fan, here, points).tolist() == [True, True, True, True]
    assert in_view(scene, fan, near, points).tolist() == [False, True, False, False]
    hidden = Scene("hidden", merge([wall, box((7.0, 4.0, 0.0), (0.2, 3.0, 3.0))]))
    assert in_view(hidden, fan, here, points).tolist() == [True, False, True, True]
    assert shared_view(scene, fan, here, RigidTransform.from_rotation(Rotation.from_euler("z", np.pi))) == 0.0
