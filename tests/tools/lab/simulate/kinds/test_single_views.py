"""Distorted and moving views, and those of the Sonar 3D-15, with the errors of their kind."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.kinds import single_view
from sonarmap.tools.lab.simulate.kinds.kind import Shot, observer_of
from sonarmap.tools.lab.simulate.scenes.scene import Scene, surface_distance
from sonarmap.tools.lab.simulate.scenes.solids import box
from sonarmap.tools.lab.simulate.sensing.noise import Noise, pick_strongest
from sonarmap.tools.lab.simulate.sensing.sensors import SONAR_3D15, Echoes, Sensor, cast
from sonarmap.tools.lab.simulate.viewpoints import Observer, View, first_view
from tests.samples.scenes.simulated import QUIET

FEW = Sensor("few", np.deg2rad(60), np.deg2rad(40), 31, 21, 0.1, 40.0)


def _shot(scene: str = "shallow", seed: int = 3) -> Shot:
    observer = observer_of(scene, 9)
    few = Observer(observer.world, replace(observer.sensor, columns=64, rows=32))
    view = first_view(few, 0.15, np.random.default_rng(2))
    return Shot(few, view, QUIET, np.random.default_rng(seed), np.random.default_rng(1), "source")


def _ranges(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points.astype(np.float64), axis=1)


@pytest.mark.parametrize("scene", ["shallow", "rubble", "flatbed"])
def test_without_distortion_the_points_lie_on_the_scenes_surface(scene: str):
    shot = _shot(scene)
    scan = single_view.distorted_scan(shot, lambda ranges: ranges)
    placed = shot.view.T_world_sensor.apply(scan.points.astype(np.float64))
    assert surface_distance(shot.observer.world.mesh, placed).max() < 1e-4
    assert (scan.name, scan.stamp, scan.prior) == ("source", 1.0, None)


@pytest.mark.parametrize(
    ("distort", "change", "undo", "within", "bounds"),
    [
        (single_view.scaled_scan, np.multiply, np.divide, (1e-5, 0.0), (0.98 - 1e-6, 0.985, 1.015, 1.02 + 1e-6)),
        (single_view.shifted_scan, np.add, np.subtract, (1e-7, 1e-4), (-0.15 - 1e-4, -0.11, 0.11, 0.15 + 1e-4)),
    ],
    ids=["a wrong sound speed", "a bias"],
)
def test_all_ranges_are_scaled_or_shifted_within_the_bounds_of_the_kind(
    distort: Callable[[Shot], Scan], change: np.ufunc, undo: np.ufunc, within: tuple, bounds: tuple
):
    true = _ranges(_shot().view.points)
    found = []
    for seed in range(30):
        measured = _ranges(distort(_shot(seed=seed)).points)
        found.append(undo(measured.min(), true.min()))
        expected = change(true, found[-1])
        assert_allclose(measured, expected[expected <= SONAR_3D15.max_range], *within)
    assert bounds[0] < min(found) < bounds[1]
    assert bounds[2] < max(found) < bounds[3]


def _wall_shot() -> Shot:
    """A view of an upright wall 10 m ahead."""
    observer = Observer(Scene("wall", box((10.5, 0, -20), (1.0, 90.0, 90.0))), FEW)
    pose = RigidTransform.from_translation((0.0, 0.0, -20.0))
    view = View(pose, cast(observer.world, FEW, pose), np.empty((0, 3)))
    return Shot(observer, view, QUIET, np.random.default_rng(0), np.random.default_rng(0), "target")


def test_points_lie_on_the_wall_from_the_poses_at_their_times():
    """Also with lost beams."""
    shot = replace(_wall_shot(), noise=Noise(dropouts=0.4))
    motion = single_view.Motion(np.array((0.8, 0.3, -0.1)), np.array((0.02, -0.03, 0.2)), 0.7)
    scan = single_view.scan_in_motion(shot, motion)
    assert scan.times is not None
    assert_allclose((scan.times[0], scan.times[-1]), (-0.35, 0.35), rtol=1e-6)
    time = scan.times.astype(np.float64)[:, None]
    T = RigidTransform.from_components(time * motion.velocity, Rotation.from_rotvec(time * motion.turning))
    assert_allclose(T.apply(scan.points.astype(np.float64))[:, 0], 10.0, atol=1e-4)
    assert np.abs(scan.points[:, 0] - 10.0).max() > 0.5
    assert single_view.distorted_scan(shot, lambda ranges: ranges).times is None


def _images(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Ranges (rows, columns) of one view of rubble, true and measured, inf without an echo."""
    observer = observer_of("rubble", seed)
    view = first_view(observer, 0.15, np.random.default_rng(seed))
    draws = (np.random.default_rng(seed + 1), np.random.default_rng(seed + 2))
    scan = single_view.real_scan(Shot(observer, view, replace(QUIET, speckle=1.0), *draws, "target"))
    # the fan is mounted nose down
    points = np.einsum("ij,ni->nj", _tilted(observer.sensor.tilt), scan.points.astype(np.float64))
    ranges = np.linalg.norm(points, axis=1)
    column = np.rint((np.arctan2(points[:, 1], points[:, 0]) / SONAR_3D15.horizontal + 0.5) * 255).astype(int)
    row = np.rint((np.arcsin(points[:, 2] / ranges) / SONAR_3D15.vertical + 0.5) * 63).astype(int)
    image = np.full((64, 256), np.inf)
    image[row, column] = ranges
    return view.echoes.ranges, image


def _tilted(tilt: float) -> np.ndarray:
    c, s = np.cos(tilt), np.sin(tilt)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def test_images_of_the_3d15_are_as_sparse_and_patchy_as_real_ones():
    images = [_images(seed) for seed in range(3)]
    seen = np.stack([np.isfinite(image) for _, image in images])
    met = np.stack([np.isfinite(true) for true, _ in images])
    assert 0.55 < seen[met].mean() < 0.9
    correlation = {lag: np.corrcoef(seen[..., :-lag].ravel(), seen[..., lag:].ravel())[0, 1] for lag in (1, 4, 16)}
    assert 0.5 < correlation[1] < 0.8
    assert 0.25 < correlation[4] < 0.6
    assert correlation[1] > correlation[4] > correlation[16]
    ranges = np.stack([image for _, image in images])
    both = seen[..., :-1] & seen[..., 1:]
    assert 0.35 < np.isclose(ranges[..., :-1][both], ranges[..., 1:][both], atol=1e-5).mean() < 0.6


def test_ranges_are_in_steps_and_near_the_surface_of_their_lobe():
    _, image = _images(5)
    ranges = image[np.isfinite(image)]
    assert_allclose(ranges / single_view.STEP, np.rint(ranges / single_view.STEP), atol=2e-2)
    observer = observer_of("shallow", 4)
    view = first_view(observer, 0.1, np.random.default_rng(4))
    draws = (np.random.default_rng(1), np.random.default_rng(2))
    scan = single_view.real_scan(Shot(observer, view, Noise(), *draws, "target"))
    placed = view.T_world_sensor.apply(scan.points.astype(np.float64))
    assert np.percentile(surface_distance(observer.world.mesh, placed), 95) < 0.15


def test_a_beam_picks_the_strongest_echo_of_its_lobe():
    ranges = np.full((5, 9), np.inf)
    strengths = np.zeros((5, 9))
    ranges[2, 2], strengths[2, 2] = 3.0, 1.0
    ranges[2, 6], strengths[2, 6] = 7.0, 0.5
    ranges[2, 3], strengths[2, 3] = 4.0, 0.1
    picked = pick_strongest(Echoes(ranges, strengths), single_view.LOBE)
    assert_array_equal(picked.ranges[2], [3.0, 3.0, 3.0, 3.0, 3.0, 7.0, 7.0, 7.0, 7.0])
    assert picked.strengths[2, 2] == 1.0
    assert_allclose(picked.strengths[2, 6], 0.5)
    assert_allclose(picked.strengths[2, 3], np.exp(-0.5))
    assert_allclose(picked.strengths[0, 2], np.exp(-2.0))
