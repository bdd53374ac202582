"""Solids and scenes: hand-computed hits of rays, closed surfaces, one seed for the same scene."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.scene import Scene, build_scene
from sonarmap.tools.lab.simulate.shapes.solids import Mesh, box, cylinder, ellipsoid, height_field, merge, shell, wall

SLANT = np.array([10.0, 1.0, -2.0])
SLANT_LENGTH = float(np.linalg.norm(SLANT))


def _volume(mesh: Mesh) -> float:
    """Signed volume of a closed surface: positive where all triangles face outward."""
    corners = mesh.vertices[mesh.triangles]
    return float(np.linalg.det(corners).sum() / 6)


def test_a_box_is_hit_where_arithmetic_says():
    scene = Scene("box", box((11.0, 2.0, -1.0), (2.0, 4.0, 6.0)))
    origins = np.array([[0, 2, 0], [0, 2, 0], [11, -7, 1.5], [11, 2, 30], [0, 2, 0]], float)
    directions = np.array([[1, 0, 0], SLANT / SLANT_LENGTH, [0, 1, 0], [0, 0, -1], [-1, 0, 0]], float)
    ranges, sines = scene.intersect(origins, directions)
    assert_allclose(ranges, [10.0, SLANT_LENGTH, 7.0, 28.0, np.inf], rtol=1e-12)
    assert_allclose(sines, [1.0, 10 / SLANT_LENGTH, 1.0, 1.0, 0.0], rtol=1e-12)


def test_a_turned_box_is_hit_on_its_corner_edge():
    scene = Scene("box", box((10.0, 0.0, 0.0), (2.0, 2.0, 2.0), Rotation.from_euler("z", np.pi / 4)))
    ranges, sines = scene.intersect(np.array([[0.0, 0.1, 0.2]]), np.array([[1.0, 0.0, 0.0]]))
    assert_allclose(ranges, 10 - np.sqrt(2) + 0.1, rtol=1e-12)
    assert_allclose(sines, np.sqrt(0.5), rtol=1e-12)


@pytest.mark.parametrize(
    ("mesh", "volume", "tolerance"),
    [
        (box((3, -2, 5), (2, 3, 4), Rotation.from_euler("ZYX", (0.3, -0.2, 0.9))), 24.0, 1e-12),
        (cylinder((1, 2, -3), (4, 2, 1), 0.7, sides=96), np.pi * 0.49 * 5, 1e-3),
        (ellipsoid((0, 1, 2), (2, 3, 1.5), Rotation.from_euler("x", 0.4), rings=40), 4 / 3 * np.pi * 9, 1e-2),
        (wall([(0, 0), (10, 0)], 2.0, -3.0, 4.0), 12 * 2 * 7, 1e-12),
    ],
)
def test_solids_are_closed_and_face_outward(mesh: Mesh, volume: float, tolerance: float):
    assert_allclose(_volume(mesh), volume, rtol=tolerance)


def test_merging_keeps_every_solid():
    both = merge([box((0, 0, 0), (1, 1, 1)), box((5, 0, 0), (2, 2, 2))])
    assert_allclose(_volume(both), 9.0)


def test_a_shell_is_closed_and_holds_what_is_between_its_sheets():
    """Half a ring of radii 3 and 2, 4 m long; its outside is met from beyond, its inside from the middle."""
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


@pytest.mark.parametrize("name", SCENE_KINDS)
def test_a_scene_is_its_seed(name: str):
    first, again, other = SCENE_KINDS[name].build(4), SCENE_KINDS[name].build(4), SCENE_KINDS[name].build(5)
    assert_array_equal(first.vertices, again.vertices)
    assert_array_equal(first.triangles, again.triangles)
    assert len(first.triangles) > 10000
    assert not np.array_equal(first.vertices, other.vertices)
    across = np.cross(*np.moveaxis(np.diff(first.vertices[first.triangles], axis=1), 1, 0))
    assert (np.linalg.norm(across, axis=1) > 0).all()


@pytest.mark.parametrize("name", ["floodgate", "harbor"])
def test_a_bed_is_under_water_and_structures_rise_above_it(name: str):
    axis = np.linspace(-120, 120, 60)
    x, y = np.meshgrid(axis, axis)
    above = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 50.0)])
    ranges, _ = build_scene(name, 0).intersect(above, np.tile([0.0, 0.0, -1.0], (x.size, 1)))
    height = 50.0 - ranges
    assert np.isfinite(height).all()
    assert -25 < np.median(height) < -12
    assert height.max() > 5
