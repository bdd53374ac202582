"""Fans of rays, drift of vehicles, and distortions of swaths, stacks and sweeps."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.simulate.kinds import imaging, profiler
from sonarmap.tools.lab.simulate.kinds.sweep import (
    Fan,
    Returns,
    Sweep,
    Water,
    meet,
    pick,
    true_points,
    walk,
    wobble,
    write_scan,
)
from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.scenes.solids import box, merge
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.sensors import Sensor
from tests.samples.refusals import refuses
from tests.samples.scenes.simulated import QUIET

SENSOR = Sensor("test", 1.0, 1.0, 2, 2, 0.5, 50.0, absorption=0.0, threshold=0.01)
AHEAD = np.array((1.0, 0.0, 0.0))


def _fan(angles: tuple[float, ...], gains: tuple[float, ...] | None = None) -> Fan:
    """One beam ahead whose rays rise by some angles [rad]."""
    rays = np.array([(np.cos(angle), 0.0, np.sin(angle)) for angle in angles])
    return Fan(SENSOR, AHEAD[None], rays[None], np.array(gains or (1.0,) * len(angles)))


def _still(place: tuple[float, float, float]) -> Sweep:
    here = RigidTransform.identity(1)
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


def test_a_beam_below_the_threshold_has_no_return():
    fan = _fan((0.0, 0.0))
    returns = pick(fan, np.array([[[4.0, np.inf]], [[4.0, 7.0]]]), np.array([[[0.009, 0.0]], [[0.009, 0.02]]]))
    assert_array_equal(returns.ranges[:, 0], (np.inf, 7.0))
    assert_array_equal(returns.strengths[:, 0], (0.0, 0.02))


def test_surfaces_above_the_water_give_no_echo():
    """A wall at x = 10 m from 6 m below the surface to 6 m above it, seen from 1 m below the surface."""
    scene = Scene("floodgate", box((10.5, 0.0, 0.0), (1.0, 40.0, 12.0)))
    fan = _fan((-0.3, 0.0, 0.3), (1.0, 1.0, 0.5))
    ranges, strengths = meet(scene, fan, _still((0.0, 0.0, -1.0)).T_world_ping)
    assert_allclose(ranges[0, 0], (10 / np.cos(0.3), 10.0, np.inf))
    assert_allclose(strengths[0, 0], (np.cos(0.3) ** 2, 1.0, 0.0))


def test_points_are_placed_by_believed_poses_and_measured_from_true_ones():
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


def test_a_sweep_without_echoes_is_refused():
    nothing = Returns(np.array([[np.inf]]), np.array([[0.0]]), np.array([[0]]))
    refuses("no beam", write_scan, _fan((0.0,)), _still((0, 0, 0)), nothing, QUIET, np.random.default_rng(1), "source")


def test_a_walk_is_zero_in_the_middle_and_has_its_sigma_at_the_ends():
    walks = np.array([walk(101, (0.3, 2.0), np.random.default_rng(seed)) for seed in range(400)])
    assert_array_equal(walks[:, 50], 0.0)
    assert_allclose(walks[:, [0, -1]].std(axis=(0, 1)), (0.3, 2.0), rtol=0.15)
    # after half the time: less by the root of two
    assert_allclose(walks[:, [25, 75]].std(axis=(0, 1)), np.array((0.3, 2.0)) / np.sqrt(2), rtol=0.15)


def test_a_wobble_has_its_sigma_everywhere_and_is_correlated_over_its_width():
    wobbles = np.array([wobble(200, (0.1,), 5.0, np.random.default_rng(seed))[:, 0] for seed in range(300)])
    assert_allclose(wobbles.std(axis=0), 0.1, rtol=0.25)
    assert np.corrcoef(wobbles[:, 50], wobbles[:, 52])[0, 1] > 0.8
    assert abs(np.corrcoef(wobbles[:, 50], wobbles[:, 80])[0, 1]) < 0.2


def test_a_path_through_a_wall_is_not_free():
    water = Water(Scene("floodgate", box((10.0, 0.0, -5.0), (1.0, 8.0, 10.0))))
    assert not water.is_way_free(np.array(((0.0, 0.0, -2.0), (5.0, 0.0, -2.0), (20.0, 0.0, -2.0))))
    assert water.is_way_free(np.array(((0.0, 0.0, -2.0), (5.0, 9.0, -2.0), (20.0, 9.0, -2.0))))
    assert not water.is_free(np.array(((10.0, 0.0, -2.0),)))
    assert not water.is_free(np.array(((0.0, 0.0, 0.5),)))
    assert water.is_free(np.array(((0.0, 0.0, -2.0),)))


# A bed 20 m deep and 256 m wide, and on it a wall along y at x = 30 m
BED = box((0.0, 0.0, -21.0), (256.0, 256.0, 2.0))
OPEN, WALLED = Scene("flatbed", BED), Scene("floodgate", merge([BED, box((31.0, 0.0, -10.0), (2.0, 250.0, 20.0))]))


def _imager(seed: int, by_depth: bool) -> imaging.Imager:
    """A sonar that stacks over depths or tilts, without multipath and side lobes."""
    rng = np.random.default_rng(seed)
    while (imager := imaging.imager(Water(WALLED), rng)).by_depth != by_depth:
        pass
    return imaging.Imager(imager.water, imager.fan, by_depth, 1.0, 0.0, 0.0)


def _wall(seed: int, by_depth: bool, imager: imaging.Imager | None = None) -> tuple[np.ndarray, Sweep]:
    """Points (N, 3) [m] of the wall in a stack from 20 m in front of it, and the stack."""
    rng = np.random.default_rng(seed)
    looking = imager or _imager(seed, by_depth)
    sweep = looking._stack(np.array((10.0, 0.0)), 0.0, rng)
    returns = looking.returns(*meet(WALLED, looking.fan, sweep.T_world_ping), sweep, rng)
    scan = write_scan(looking.fan, sweep, returns, Noise(), rng, "source")
    points = scan.points.astype(np.float64)
    return points[np.abs(points[:, 1]) < 4.0], sweep


def test_elevations_of_echoes_err_within_the_aperture():
    """The bed below a tilted sonar is thick, and off by up to half the aperture, although every range is right."""
    imager = _imager(3, by_depth=False)
    rng = np.random.default_rng(3)
    sweep = imager._stack(np.array((-60.0, 0.0)), np.pi, rng)
    returns = imager.returns(*meet(OPEN, imager.fan, sweep.T_world_ping), sweep, rng)
    seen = np.isfinite(returns.ranges)
    ping, beam = np.nonzero(seen)
    truly = imager.fan.rays[beam, returns.rays[seen]]
    off = np.rad2deg(np.arccos(np.clip(np.einsum("ij,ij->i", truly, imager.fan.beams[beam]), -1, 1)))
    assert 1.0 < off.mean() < 5.0
    assert off.max() == pytest.approx(6.0, abs=0.01)
    points = sweep.T_frame_believed[ping].apply(imager.fan.beams[beam] * returns.ranges[seen][:, None])
    assert points[:, 2].std() > 0.3


@pytest.mark.slow
def test_multipath_lies_behind_the_wall_and_arcs_keep_the_loudest_range():
    bare = _imager(4, by_depth=True)
    loud = imaging.Imager(bare.water, bare.fan, True, 1.0, 0.05, 0.0)
    behind = [np.mean(_wall(4, True, sonar)[0][:, 0] > 24.0) for sonar in (bare, loud)]
    assert behind[0] < 0.005
    assert 0.02 < behind[1] < 0.06
    arcs = imaging.Imager(bare.water, bare.fan, True, 1.0, 0.0, 0.2)
    rng, sweep = np.random.default_rng(1), bare._stack(np.array((10.0, 0.0)), 0.6, np.random.default_rng(1))
    ranges, strengths = meet(WALLED, bare.fan, sweep.T_world_ping)
    returns = arcs.returns(ranges, strengths, sweep, rng)
    _, often = np.unique(np.round(returns.ranges[5][np.isfinite(returns.ranges[5])], 9), return_counts=True)
    assert often.max() >= 25


def test_points_of_a_panned_head_are_in_the_vehicles_frame_at_their_times():
    """The vehicle's true poses at their times give the true points; a turning vehicle has placed them itself."""
    turned = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        head = profiler.profiler(Water(OPEN), rng)
        sweep = head.target(rng)
        few = sweep.thinned(5)
        fan = Fan(SENSOR, head.fan.beams[::7], head.fan.beams[::7, None], np.ones(1))
        shape = len(few.T_frame_ping), len(fan.beams)
        returns = Returns(rng.uniform(5.0, 40.0, shape), np.ones(shape), np.zeros(shape, int))
        scan = write_scan(fan, few, returns, QUIET, rng, "target")
        turned += head.turning
        assert (scan.times is None) == head.turning
        if scan.times is None:
            continue
        assert few.times is not None
        assert_allclose(few.times[:2], profiler.SECONDS * (np.array((0, 5)) - len(head.pans) // 2))
        assert_array_equal(scan.times, np.repeat(few.times, shape[1]).astype(np.float32))
        T_frame_vehicle = few.T_frame_ping * few.T_frame_believed.inv()
        ping = np.searchsorted(few.times, scan.times)
        placed = T_frame_vehicle[ping].apply(scan.points.astype(np.float64))
        assert_allclose(placed, true_points(fan, few, returns), atol=1e-4)
    assert 0 < turned < 8
