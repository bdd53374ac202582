"""Surfaces read back by trimesh."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.map_folder.folder import MapPart
from sonarmap.tools.products.export.grid import write_mesh
from tests.tools.products.export.finished import georeferenced


def part_of(points: np.ndarray) -> MapPart:
    """A map of these points, seen from one place."""
    T = RigidTransform.from_translation(np.zeros((1, 3)))
    part = georeferenced(Georeference(60.0, 5.0), T, len(points)).part
    return replace(part, points=points)


def read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) in x, y, z of the map, and triangles."""
    if path.suffix == ".ply":
        mesh: Any = trimesh.load_mesh(path, process=False)
        return np.asarray(mesh.vertices), np.asarray(mesh.faces)
    scene: Any = trimesh.load_scene(path, process=False)
    (mesh,) = scene.dump()  # with the nodes' translations
    x, up, toward = np.asarray(mesh.vertices).T
    return np.column_stack([x, -toward, up]), np.asarray(mesh.faces)


def slope(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.25 * x - 0.5 * y - 7


@pytest.mark.parametrize(("suffix", "far"), [("ply", 0.0), ("glb", 431_000.0)])
def test_the_grid_is_a_sheet_that_looks_up(tmp_path: Path, suffix: str, far: float) -> None:
    """A corner cell and one in the middle are missing: the corner's square keeps a triangle, and so do four others."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(7) + 0.5, np.arange(5) + 0.5))
    kept = ~((x == 3.5) & (y == 2.5)) & ~((x == 6.5) & (y == 4.5))
    points = np.column_stack([x, y, slope(x, y)])[kept] + [far, -2 * far, 0]
    path = tmp_path / f"surface.{suffix}"
    said = write_mesh(path, part_of(points), 1.0)
    vertices, triangles = read(path)
    assert (said["vertices"], said["triangles"]) == (len(vertices), len(triangles)) == (33, 2 * 19 + 5)
    order, wanted = np.lexsort(vertices.T[:2]), np.lexsort(points.T[:2])
    np.testing.assert_allclose(vertices[order], points[wanted], rtol=0, atol=1e-3)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0).all()
    assert normals[:, 2].sum() / 2 == pytest.approx(19 + 5 / 2, abs=0.05)  # the squares' area from above


def test_lone_points_have_no_surface(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--cell M"):
        write_mesh(tmp_path / "surface.ply", part_of(np.array([[0.0, 0, 0], [9.0, 0, 0], [0, 9.0, 0]])), 1.0)
