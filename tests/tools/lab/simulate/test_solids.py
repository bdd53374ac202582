"""Solids, surfaces and structures: hand-computed hits of rays, closed surfaces, open beds."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.structures import occupy, surface_points
from sonarmap.tools.lab.simulate.scenes.bed import raster
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.scene import Scene, surface_distance, triangle_distance
from sonarmap.tools.lab.simulate.scenes.solids import Mesh, box, cylinder, ellipsoid, height_field, merge, shell, wall

SLANT = np.array([10.0, 1.0, -2.0])
SLANT_LENGTH = float(np.linalg.norm(SLANT))


def _volume(mesh: Mesh) -> float:
    """Signed volume of a closed surface: positive where all triangles face outward."""
    corners = mesh.vertices[mesh.triangles]
    return float(np.linalg.det(corners).sum() / 6)


def test_rays_hit_a_box_at_hand_computed_ranges():
    scene = Scene("box", box((11.0, 2.0, -1.0), (2.0, 4.0, 6.0)))
    origins = np.array([[0, 2, 0], [0, 2, 0], [11, -7, 1.5], [11, 2, 30], [0, 2, 0]], float)
    directions = np.array([[1, 0, 0], SLANT / SLANT_LENGTH, [0, 1, 0], [0, 0, -1], [-1, 0, 0]], float)
    ranges, sines = scene.intersect(origins, directions)
    assert_allclose(ranges, [10.0, SLANT_LENGTH, 7.0, 28.0, np.inf], rtol=1e-12)
    assert_allclose(sines, [1.0, 10 / SLANT_LENGTH, 1.0, 1.0, 0.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("mesh", "volume", "tolerance"),
    [
        (box((3, -2, 5), (2, 3, 4), Rotation.from_euler("ZYX", (0.3, -0.2, 0.9))), 24.0, 1e-12),
        (cylinder((1, 2, -3), (4, 2, 1), 0.7, sides=96), np.pi * 0.49 * 5, 1e-3),
        (ellipsoid((0, 1, 2), (2, 3, 1.5), Rotation.from_euler("x", 0.4), rings=40), 4 / 3 * np.pi * 9, 1e-2),
        (wall([(0, 0), (10, 0)], 2.0, -3.0, 4.0), 12 * 2 * 7, 1e-12),
        (merge([box((0, 0, 0), (1, 1, 1)), box((5, 0, 0), (2, 2, 2))]), 9.0, 1e-12),
    ],
)
def test_solids_are_closed_and_face_outward(mesh: Mesh, volume: float, tolerance: float):
    assert_allclose(_volume(mesh), volume, rtol=tolerance)


def test_a_shell_is_closed_and_solid_between_its_sheets():
    """Half a ring of radii 3 and 2 m, 4 m long."""
    x, angle = np.meshgrid(np.linspace(0, 4, 5), np.linspace(0, np.pi, 181), indexing="ij")
    outer, inner = (np.stack([x, r * np.cos(angle), -r * np.sin(angle)], axis=-1) for r in (3.0, 2.0))
    mesh = shell(outer, inner)
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    assert_allclose(np.einsum("ni,ni->", a, np.cross(b, c)) / 6, 4 * np.pi * (9 - 4) / 2, rtol=1e-3)
    edges = np.concatenate([mesh.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    there = {tuple(edge) for edge in edges.tolist()}
    assert len(there) == len(edges)
    assert there == {(end, start) for start, end in there}
    scene = Scene("shell", mesh)
    places = np.array([[2, 0, -2.5], [2, -2.5, -0.1], [2, 0, -1.0], [2, 0, -3.5], [4.5, 0, -2.5]])
    assert scene.is_solid(places).tolist() == [True, True, False, False, False]


def test_a_height_field_is_seen_from_above_at_its_heights():
    x, y = np.array([0.0, 2.0, 5.0]), np.array([-1.0, 1.0])
    field = height_field(x, y, np.array([[0.0, 0.0], [4.0, 4.0], [4.0, 4.0]]))
    down = np.tile([0.0, 0.0, -1.0], (2, 1))
    ranges, sines = Scene("step", field).intersect(np.array([[1.0, 0.3, 20], [3.0, -0.4, 20]]), down)
    assert_allclose(ranges, [18.0, 16.0])
    assert_allclose(sines, [1 / np.sqrt(5), 1.0])


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("name", SCENE_KINDS)
def test_a_scene_depends_only_on_its_seed(name: str):
    first, again, other = SCENE_KINDS[name].build(4), SCENE_KINDS[name].build(4), SCENE_KINDS[name].build(5)
    assert_array_equal(first.vertices, again.vertices)
    assert_array_equal(first.triangles, again.triangles)
    assert len(first.triangles) > 10000
    still = min(len(first.vertices), len(other.vertices))
    assert np.isclose(first.vertices[:still], other.vertices[:still], atol=1e-3).all(axis=1).mean() < 0.95
    across = np.cross(*np.moveaxis(np.diff(first.vertices[first.triangles], axis=1), 1, 0))
    assert (np.linalg.norm(across, axis=1) > 0).all()


TURN = Rotation.from_euler("ZYX", [0.7, -0.3, 0.2])
CENTER, SIZE = np.array([30.0, -12.0, -7.0]), np.array([8.0, 3.0, 5.0])


def box_distance(points: np.ndarray) -> np.ndarray:
    """Distances [m] to the turned box's surface; from inside, to the nearest face."""
    out = np.abs(TURN.inv().apply(points - CENTER)) - SIZE / 2
    outside = np.linalg.norm(np.maximum(out, 0), axis=1)
    return np.where((out <= 0).all(axis=1), -out.max(axis=1), outside)


class TestSurfaceDistance:
    def test_distances_from_inside_and_outside_a_turned_box(self) -> None:
        """Random points are nearest to faces, edges or corners."""
        points = CENTER + np.random.default_rng(1).uniform(-12, 12, (4000, 3))
        found = surface_distance(box(CENTER, SIZE, TURN), points)
        assert found == pytest.approx(box_distance(points), abs=1e-5)

    def test_the_nearest_of_several_solids_counts(self) -> None:
        both = merge([box((0, 0, 0), (2, 2, 2)), box((10, 0, 0), (4, 2, 2))])
        points = np.array([[4.0, 0, 0], [5.0, 0, 0], [0, 0, 0], [0, 0, 3.5]])
        assert surface_distance(both, points) == pytest.approx([3, 3, 1, 2.5], abs=1e-6)
        assert surface_distance(both, points[:0]).shape == (0,)


class TestTriangleDistance:
    def test_degenerate_triangles_have_finite_distances(self) -> None:
        corners = np.array([[[0, 0, 0], [4, 0, 0], [2, 0, 0]], [[1, 1, 1]] * 3], float)
        points = np.array([[2, 3, 0], [1, 3, 1]], float)
        assert triangle_distance(corners, points) == pytest.approx([3, 2])
        flat = Mesh(np.concatenate(corners), np.array([[0, 1, 2], [3, 4, 5]]))
        assert np.isfinite(surface_distance(flat, points)).all()


class TestSurfacePoints:
    def test_points_lie_on_the_surface_and_cover_it(self) -> None:
        """On a box of 6 x 4 x 2 m, whose surface is known."""
        points = surface_points(box((3, -1, 7), (6, 4, 2)), 0.25) - np.array([3, -1, 0], np.float32)
        half = np.array([3, 2, 1])
        assert np.abs(np.max(np.abs(points) / half, axis=1) - 1).max() < 1e-5
        random = np.random.default_rng(5).uniform(-1, 1, (3000, 3)) * half
        face = np.random.default_rng(6).integers(0, 3, len(random))
        random[np.arange(len(random)), face] = np.sign(random[np.arange(len(random)), face]) * half[face]
        assert KDTree(points).query(random)[0].max() < 0.25


class TestOccupy:
    def test_voxels_are_centered_on_whole_steps(self) -> None:
        grid = Grid(16, 0.5)
        points = np.array([[0, 0, 0], [0.24, -0.26, 1.0], [-4.0, 3.5, 0], [4.1, 0, 0], [0, -4.3, 0]])
        occupied = occupy(points, grid)
        assert set(map(tuple, np.argwhere(occupied).tolist())) == {(8, 8, 8), (8, 7, 10), (0, 15, 8)}


COUNT = len(raster()) ** 2


def _heights(bed: Mesh) -> np.ndarray:
    """Heights [m] of the bed without its rocks, above the plane that fits it best."""
    ground = bed.vertices[:COUNT]
    level = np.column_stack([ground[:, :2], np.ones(COUNT)])
    return ground[:, 2] - level @ np.linalg.lstsq(level, ground[:, 2], rcond=None)[0]


@pytest.mark.parametrize("seed", [3])
@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("flatbed", 0.08, 0.12), ("sandflat", 0.08, 0.12), ("seabed", 0.5, 2.0), ("shallow", 0.078, 0.32)],
)
def test_a_bed_has_the_relief_that_its_name_promises(name: str, seed: int, least: float, most: float):
    low, high = np.percentile(_heights(SCENE_KINDS[name].build(seed)), [2, 98])
    assert least < high - low < most
