"""Scenes as volumes of voxels: every part of a surface, at its place."""

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.simulate.shapes.solids import box, ellipsoid, merge
from sonarmap.tools.lab.simulate.shapes.structure import occupy, surface_points, voxel_scan


class TestSurfacePoints:
    def test_they_lie_on_the_surface_and_cover_it(self) -> None:
        """On a box of 6 x 4 x 2 m, whose surface is known."""
        points = surface_points(box((3, -1, 7), (6, 4, 2)), 0.25) - np.array([3, -1, 0], np.float32)
        half = np.array([3, 2, 1])
        assert np.abs(np.max(np.abs(points) / half, axis=1) - 1).max() < 1e-5
        random = np.random.default_rng(5).uniform(-1, 1, (3000, 3)) * half
        face = np.random.default_rng(6).integers(0, 3, len(random))
        random[np.arange(len(random)), face] = np.sign(random[np.arange(len(random)), face]) * half[face]
        assert KDTree(points).query(random)[0].max() < 0.25

    def test_small_and_large_triangles_have_the_same_spacing(self) -> None:
        mesh = merge([box((0, 0, 0), (20, 1, 1)), ellipsoid((5, 5, 5), (3, 2, 1), Rotation.identity())])
        points = surface_points(mesh, 0.5)
        distance = KDTree(points).query(
            mesh.vertices - [0, 0, (mesh.vertices[:, 2].min() + mesh.vertices[:, 2].max()) / 2]
        )
        assert distance[0].max() < 1e-5

    def test_the_height_is_about_zero(self) -> None:
        points = surface_points(box((0, 0, 40), (3, 3, 8)), 1.0)
        assert points[:, 2].min() == -4
        assert points[:, 2].max() == 4


class TestOccupy:
    def test_voxels_are_centered_on_whole_steps(self) -> None:
        grid = Grid(16, 0.5)
        points = np.array([[0, 0, 0], [0.24, -0.26, 1.0], [-4.0, 3.5, 0], [4.1, 0, 0], [0, -4.3, 0]])
        occupied = occupy(points, grid)
        assert set(map(tuple, np.argwhere(occupied).tolist())) == {(8, 8, 8), (8, 7, 10), (0, 15, 8)}

    def test_a_scan_of_it_has_the_points_in_their_voxels(self) -> None:
        grid = Grid(32, 0.7)
        points = np.random.default_rng(3).uniform(-10.8, 10.8, (500, 3))
        scan = voxel_scan(occupy(points, grid), grid, "s")
        assert np.abs(scan.points[KDTree(scan.points).query(points)[1]] - points).max() <= 0.35 + 1e-5
        assert (occupy(scan.points, grid) == occupy(points, grid)).all()
