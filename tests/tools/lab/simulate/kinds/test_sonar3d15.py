"""The Sonar 3D-15's views are as sparse, as patchy and as coarse as the recorded ones."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from sonarmap.tools.lab.simulate.kinds.draws import observer_of
from sonarmap.tools.lab.simulate.kinds.single_view import LOBE, STEP, Shot, real_scan
from sonarmap.tools.lab.simulate.pairs.viewpoints import first_view
from sonarmap.tools.lab.simulate.sensing.noise import Noise, pick_strongest
from sonarmap.tools.lab.simulate.sensing.sensors import SONAR_3D15, Echoes
from sonarmap.tools.lab.simulate.shapes.surface import surface_distance
from tests.samples.simulated import QUIET


def _images(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Ranges (rows, columns) of one view of rubble, true and measured, inf without an echo."""
    observer = observer_of("rubble", seed)
    view = first_view(observer, 0.15, np.random.default_rng(seed))
    draws = (np.random.default_rng(seed + 1), np.random.default_rng(seed + 2))
    scan = real_scan(Shot(observer, view, replace(QUIET, speckle=1.0), *draws, "target"))
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


def test_its_images_are_as_sparse_and_as_patchy_as_real_ones():
    images = [_images(seed) for seed in range(3)]
    seen = np.stack([np.isfinite(image) for _, image in images])
    met = np.stack([np.isfinite(true) for true, _ in images])
    assert 0.55 < seen[met].mean() < 0.9
    alike = {lag: np.corrcoef(seen[..., :-lag].ravel(), seen[..., lag:].ravel())[0, 1] for lag in (1, 4, 16)}
    assert 0.5 < alike[1] < 0.8
    assert 0.25 < alike[4] < 0.6
    assert alike[1] > alike[4] > alike[16]
    ranges = np.stack([image for _, image in images])
    both = seen[..., :-1] & seen[..., 1:]
    assert 0.35 < np.isclose(ranges[..., :-1][both], ranges[..., 1:][both], atol=1e-5).mean() < 0.6


def test_ranges_come_in_steps_and_lie_near_the_surface_of_their_lobe():
    _, image = _images(5)
    ranges = image[np.isfinite(image)]
    assert_allclose(ranges / STEP, np.rint(ranges / STEP), atol=2e-2)
    observer = observer_of("shallow", 4)
    view = first_view(observer, 0.1, np.random.default_rng(4))
    draws = (np.random.default_rng(1), np.random.default_rng(2))
    scan = real_scan(Shot(observer, view, Noise(), *draws, "target"))
    placed = view.T_world_sensor.apply(scan.points.astype(np.float64))
    assert np.percentile(surface_distance(observer.world.mesh, placed), 95) < 0.15


def test_a_beam_picks_the_strongest_echo_of_its_lobe():
    ranges = np.full((5, 9), np.inf)
    strengths = np.zeros((5, 9))
    ranges[2, 2], strengths[2, 2] = 3.0, 1.0
    ranges[2, 6], strengths[2, 6] = 7.0, 0.5
    ranges[2, 3], strengths[2, 3] = 4.0, 0.1
    picked = pick_strongest(Echoes(ranges, strengths), LOBE)
    assert_array_equal(picked.ranges[2], [3.0, 3.0, 3.0, 3.0, 3.0, 7.0, 7.0, 7.0, 7.0])
    assert picked.strengths[2, 2] == 1.0
    assert_allclose(picked.strengths[2, 6], 0.5)
    assert_allclose(picked.strengths[2, 3], np.exp(-0.5))
    assert_allclose(picked.strengths[0, 2], np.exp(-2.0))
