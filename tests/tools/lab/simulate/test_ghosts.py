"""Multipath ghosts over a flat bed, a wall and the water's surface."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.scenes.solids import box, merge
from sonarmap.tools.lab.simulate.sensing.noise import MIRROR_LOSS_DB, Noise, disturb, reflect
from sonarmap.tools.lab.simulate.sensing.sensors import ABSORPTION_DB, ECLIPSE, Echoes, bare, cast
from tests.samples.refusals import refuses
from tests.samples.scenes.simulated import COARSE

WALL, BED = 30.0, -11.0  # x of the wall's face, height of the bed [m]
BASIN = Scene("basin", merge([box((0, 0, BED - 2), (400, 400, 4)), box((WALL + 3, 0, 0), (6, 400, 80))]))
SENSOR = replace(COARSE, max_range=200.0)


def seen_from(depth: float) -> tuple[np.ndarray, Echoes, Echoes, float]:
    """World directions, echoes and ghosts from a turned sensor `depth` under water, and its distance to the wall."""
    pose = RigidTransform.from_components(
        (4.0, -7.0, -depth), Rotation.from_euler("ZYX", np.deg2rad((17.0, 6.0, -4.0)))
    )
    directions = pose.rotation.apply(SENSOR.directions().reshape(-1, 3)).reshape(21, 33, 3)
    return directions, cast(BASIN, SENSOR, pose), reflect(BASIN, SENSOR, pose), WALL - 4.0


def test_ghosts_over_bed_and_surface_have_the_range_of_the_straight_path():
    depth = 3.0
    directions, echoes, ghosts, to_wall = seen_from(depth)
    x, z = directions[..., 0], directions[..., 2]
    above_bed = -BED - depth
    at_wall = to_wall / x * z  # how far the straight beam has risen there [m]
    over_bed = (at_wall < -above_bed) & (at_wall > -above_bed + BED)
    over_water = (at_wall > depth) & (at_wall < depth - BED)
    over_wall = (at_wall > -above_bed) & (at_wall < 0)
    steep_up = at_wall > depth - BED
    level = (at_wall > 0) & (at_wall < depth)
    for part in (over_bed, over_water, over_wall, steep_up, level):
        assert part.sum() >= 10
    # a mirror only folds the straight path, whose length stays the same
    assert_allclose(ghosts.ranges[over_bed], (to_wall / x)[over_bed], rtol=1e-9)
    assert_allclose(ghosts.ranges[over_water], (to_wall / x)[over_water], rtol=1e-9)
    down = np.where(above_bed < -z * SENSOR.max_range, above_bed / -z, np.inf)
    assert_allclose(ghosts.ranges[over_wall], down[over_wall], rtol=1e-9)
    assert np.isfinite(down[over_wall]).sum() >= 10
    assert_allclose(ghosts.ranges[steep_up], ((depth - BED) / z)[steep_up], rtol=1e-9)
    # from the wall up to the water's surface and no third mirror
    assert np.isinf(ghosts.ranges[level]).all()
    both = np.isfinite(ghosts.ranges) & ~over_water & ~steep_up
    assert (ghosts.ranges[both] > echoes.ranges[both]).all()


def test_a_ghost_has_lamberts_strength_at_the_second_surface_less_the_mirrors_loss():
    directions, _, ghosts, to_wall = seen_from(3.0)
    x, z = directions[..., 0], directions[..., 2]
    over_bed = (to_wall / x * z < BED + 3.0) & (to_wall / x * z > 2 * BED + 3.0)
    decibel = 20 * np.log10(x) - 2 * ABSORPTION_DB * to_wall / x - MIRROR_LOSS_DB
    assert_allclose(10 * np.log10(ghosts.strengths[over_bed]), decibel[over_bed], rtol=1e-6)


def test_above_the_water_upward_beams_have_no_ghosts():
    directions, echoes, ghosts, to_wall = seen_from(-5.0)
    rising = directions[..., 2] > 0.02
    assert rising.any()
    assert np.isinf(ghosts.ranges[rising]).all()
    over_bed = echoes.ranges < to_wall / directions[..., 0] - 1e-6
    assert np.isfinite(ghosts.ranges[over_bed]).any()


def test_a_share_of_the_beams_reports_its_ghost():
    shape = (200, 300)
    echoes = Echoes(np.full(shape, 20.0), np.full(shape, 0.9))
    echoes.ranges[:50] = np.inf
    ghosts = Echoes(np.full(shape, 33.0), np.full(shape, 0.2))
    ghosts.ranges[:, 200:] = np.inf
    heard = disturb(echoes, bare(ECLIPSE), Noise(ghosts=0.15), np.random.default_rng(4), ghosts)
    is_ghost = heard.ranges == 33.0
    assert not is_ghost[:, 200:].any()
    assert_allclose(is_ghost[:, :200].mean(), 0.15, atol=4 * np.sqrt(0.15 * 0.85 / 40000))
    assert is_ghost[:50].any()
    assert_array_equal(heard.strengths[is_ghost], 0.2)
    assert_array_equal(heard.ranges[~is_ghost], echoes.ranges[~is_ghost])


def test_noise_with_ghosts_needs_their_echoes():
    echoes = Echoes(np.full((2, 3), 20.0), np.ones((2, 3)))
    refuses(r"wanted those of reflect\(\)", disturb, echoes, ECLIPSE, Noise(ghosts=0.1), np.random.default_rng(4))
