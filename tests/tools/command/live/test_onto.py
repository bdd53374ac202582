"""A finished map as key scans: what a sensor would see of it where one was, and where these lie."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.command.live.kept_keys import map_keys
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.files.readers.incoming import Mark

VOXEL = 0.25
HALF_VIEW, REACH = np.radians(40.0), 6.0  # of the sensor that made the map


def map_of(spacing: float, count: int = 9) -> tuple[Map, RigidTransform]:
    """A wall of 30 m, seen from a way along it; of which every point is mostly of the nearest scan."""
    x = np.arange(count) * spacing
    R = Rotation.from_euler("ZYX", np.column_stack([np.full(count, np.pi / 2), 0.02 * x, 0.03 * np.sin(x)]))
    T = RigidTransform.from_components(np.column_stack([x - 1.0, 0.1 * x, np.full(count, -2.0)]), R)
    wall = np.stack(np.meshgrid(np.arange(-10, 20, 0.2), [4.0], np.arange(-4, 0, 0.2), indexing="ij"), -1).reshape(
        -1, 3
    )
    near = np.argmin(np.linalg.norm(wall[:, None] - T.translation, axis=2), axis=1)
    local = RigidTransform.concatenate([T[k] for k in near]).inv().apply(wall)
    seen = (np.linalg.norm(local, axis=1) < REACH) & (local[:, 0] > np.cos(HALF_VIEW) * np.linalg.norm(local, axis=1))
    wall, near = wall[seen], near[seen]
    scans = tuple(range(3, 3 + count))
    columns = {"scan": near + 3}
    trajectory = Trajectory(50.0 + np.arange(count), T)
    part = MapPart("", wall, columns, scans, trajectory, np.zeros((count, 6, 6)), in_world=True)
    names = tuple(f"old{k}" for k in range(3 + count))
    return Map(Path("map"), names, (part,), (), VOXEL, {}, None, {}), T


def test_key_scans_are_apart_and_lie_as_the_map_has_them() -> None:
    folder, T = map_of(spacing=1.0)
    keys = list(map_keys(folder))
    assert [key.scan.name for key in keys] == [
        "map:old3",
        "map:old5",
        "map:old7",
        "map:old9",
        "map:old11",
    ]  # more than 8 voxels of 0.25 m
    assert [key.scan.stamp for key in keys] == [50.0, 52.0, 54.0, 56.0, 58.0]
    prior = keys[0].scan.prior
    assert prior is not None
    assert prior.is_complete
    np.testing.assert_allclose(prior.T_world_sensor.as_matrix(), T[0].as_matrix(), atol=1e-12)
    assert keys[0].step is None
    for key, step in zip(keys[1:], T[:-2:2].inv() * T[2::2], strict=True):
        assert key.scan.prior is None
        assert key.step is not None
        np.testing.assert_allclose(key.step.T_target_source.as_matrix(), step.as_matrix(), atol=1e-12)
    assert all(key.behind == Mark() and key.voxel == VOXEL for key in keys)


def test_a_key_scan_is_what_the_sensor_saw_with_what_others_saw_there() -> None:
    folder, T = map_of(spacing=1.0)
    key = list(map_keys(folder))[1]
    points = key.scan.points.astype(np.float64)
    far = np.linalg.norm(points, axis=1)
    assert far.max() < REACH
    assert (points[:, 0] / far).min() > np.cos(HALF_VIEW) - 1e-6
    own = T[2].inv().apply(folder.parts[0].points[folder.parts[0].columns["scan"] == 5])
    assert len(points) > 2 * len(own)
    world = T[2].apply(points)
    np.testing.assert_allclose(world[:, 1], 4.0, atol=1e-5)  # on the wall, in the map's frame


def test_a_map_without_enough_points_of_any_scan_is_refused() -> None:
    folder, _ = map_of(spacing=1.0)
    part = folder.parts[0]
    few = MapPart(
        "", part.points[:40], {"scan": part.columns["scan"][:40]}, part.scans, part.trajectory, part.covariances, True
    )
    with pytest.raises(InputError, match="no scan of the map has 50 points"):
        list(map_keys(Map(Path("map"), folder.names, (few,), (), VOXEL, {}, None, {})))
