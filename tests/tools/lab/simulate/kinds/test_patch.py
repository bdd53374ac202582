"""Patches: views from a path merged in one frame, with odometry errors, and thinned."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.kinds import patch
from sonarmap.tools.lab.simulate.kinds.kind import Shot, observer_of
from sonarmap.tools.lab.simulate.scenes.scene import surface_distance
from sonarmap.tools.lab.simulate.viewpoints import first_view
from tests.samples.scenes.simulated import QUIET


def _patch(scene: str = "rubble") -> tuple[patch.PathObserver, patch.PathView]:
    still = observer_of(scene, 3)
    few = type(still)(still.world, replace(still.sensor, columns=96, rows=48))
    observer = patch.on_path(few, np.random.default_rng(11))
    view = first_view(observer, 0.1, np.random.default_rng(5))
    assert isinstance(view, patch.PathView)
    return observer, view


def _merged(observer: patch.PathObserver, view: patch.PathView, number: int = 0) -> Scan:
    draws = np.random.default_rng(1), np.random.default_rng(2)
    return patch.merged_scan(Shot(observer, view, QUIET, *draws, "target", number))


@pytest.mark.parametrize("scene", ["rubble", "seabed"])
def test_with_true_odometry_a_patch_lies_on_the_scenes_surface(scene: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(patch, "DRIFT", 0.0)
    monkeypatch.setattr(patch, "TURNED", 0.0)
    observer, view = _patch(scene)
    scan = _merged(observer, view)
    for points in (scan.points.astype(np.float64), view.points):
        placed = view.T_world_sensor.apply(points)
        assert surface_distance(observer.world.mesh, placed).max() < 2e-4
    assert scan.viewpoints is not None
    assert_allclose(np.unique(scan.viewpoints, axis=0), _sorted(observer.T_middle_look.translation), atol=1e-6)
    assert _merged(observer, view, 1).viewpoints is None


def _sorted(places: np.ndarray) -> np.ndarray:
    return np.unique(places.astype(np.float32), axis=0)


def test_odometry_drifts_from_the_middle_of_the_path_by_its_sigmas():
    path = patch.draw_path(9, 2.0, np.random.default_rng(0))
    off = [patch.believed_path(path, 0.5, np.random.default_rng(seed)) for seed in range(400)]
    shifts = np.stack([believed.translation - path.translation for believed in off])
    turns = np.stack([(path.rotation.inv() * believed.rotation).as_rotvec() for believed in off])
    assert_array_equal(shifts[:, 4], 0.0)
    assert_allclose(turns[:, 4], 0.0, atol=1e-12)
    assert_allclose(shifts[:, 0].std(axis=0), 0.5 * 0.2 * np.sqrt(4 / 4.5), rtol=0.15)
    assert_allclose(turns[:, -1].std(axis=0), np.deg2rad(0.3) * np.sqrt(4 / 4.5), rtol=0.15)
    assert (shifts[:, 0].std(axis=0) > 1.5 * shifts[:, 3].std(axis=0)).all()


def test_thinning_keeps_one_point_per_cell_and_isolated_points_are_marked():
    points = np.array([[0.1, 0.1, 0.1], [0.3, 0.2, 0.1], [1.2, 0.1, 0.1], [-0.1, 0.1, 0.1], [0.4, 0.4, 0.4]])
    assert_array_equal(patch.thinned(points, 0.5), [0, 2, 3])
    assert_array_equal(patch.lonely(points, 0.5), [False, False, True, True, False])
    turned = Rotation.from_euler("z", 90, degrees=True).apply(points)
    assert len(patch.thinned(turned, 0.5)) == 3
