"""The paper's chain on structures seen whole: its steps, its window, its grid that stands still."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere.registration import HemisphereConfig, HemisphereRegistrar
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.shapes.structure import occupy, surface_points, voxel_scan

GRID = Grid(64, 4.0)


@pytest.fixture(scope="module")
def registrar() -> HemisphereRegistrar:
    return HemisphereRegistrar(choose_device(), GRID, HemisphereConfig.paper(centered=False))


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    return surface_points(build_scene("clutter", 5).mesh, 2.0).astype(np.float64)


def register(registrar: HemisphereRegistrar, points: np.ndarray, T_target_source: RigidTransform) -> RigidTransform:
    moved, still = (voxel_scan(occupy(p, GRID), GRID, "s") for p in (T_target_source.apply(points), points))
    return registrar.register(registrar.prepare(moved), registrar.prepare(still)).T_target_source


@pytest.mark.parametrize("shift", [(8.0, -16.0, 24.0), (40.0, 80.0, 12.0)])
def test_a_shift_is_exact(registrar: HemisphereRegistrar, points: np.ndarray, shift: tuple[float, ...]) -> None:
    T = register(registrar, points, RigidTransform.from_translation(shift))
    assert np.linalg.norm(T.translation - shift) < 0.2 * GRID.voxel
    assert np.rad2deg(T.rotation.magnitude()) < 0.5


@pytest.mark.parametrize("yaw", [-70.0, 24.0, 64.0])
def test_yaw_under_tilt_keeps_to_what_the_paper_shows(registrar, points, yaw):
    """Figs. 16 and 17: 10 degrees of roll and of pitch."""
    R = Rotation.from_euler("ZYX", [yaw, 10, 10], degrees=True)
    off = register(registrar, points, RigidTransform.from_rotation(R)).rotation.as_euler("ZYX", degrees=True)
    assert np.abs(off - [yaw, 10, 10])[0] < 5
    assert np.abs(off - [yaw, 10, 10])[1:].max() < 3


def test_a_grid_that_stands_still_loses_what_leaves_it(registrar: HemisphereRegistrar, points: np.ndarray) -> None:
    prepared = registrar.prepare(voxel_scan(occupy(points, GRID), GRID, "s"))
    assert (prepared.volume.center == 0).all()
    away = RigidTransform.from_translation([150.0, 0, 0]).apply(points).astype(np.float32)
    with pytest.raises(InputError, match="the grid of 64 voxels"):
        registrar.prepare(Scan(away))
