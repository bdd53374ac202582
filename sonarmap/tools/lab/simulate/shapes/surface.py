"""How far points lie from a scene's true surface."""

from typing import Any

import numpy as np

from sonarmap.tools.lab.simulate.shapes.solids import Mesh


def surface_distance(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """The distance (N,) float64 [m] of every point (N, 3) to the mesh's nearest triangle, on whichever side of it.

    Open3D's search says which triangle is nearest; the distance to it is then computed in float64, so that it is exact
    and the same whatever the machine's vector unit.
    """
    import open3d as o3d

    places = np.asarray(points, np.float64)
    if len(places) == 0:
        return np.empty(0)
    query = o3d.core.Tensor.from_numpy(np.ascontiguousarray(places, np.float32))
    nearest = caster(mesh).compute_closest_points(query)["primitive_ids"].numpy().astype(np.int64)
    return triangle_distance(mesh.vertices[mesh.triangles[nearest]], places)


def triangle_distance(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The distance (N,) of each point (N, 3) to its own triangle (N, 3, 3), [m]; a triangle may be a line or a dot."""
    sides = np.roll(corners, -1, axis=1) - corners
    away = points[:, None, :] - corners
    # to the sides: the foot of the perpendicular, kept between the side's ends
    length2 = np.einsum("nij,nij->ni", sides, sides)
    along = np.einsum("nij,nij->ni", away, sides) / np.where(length2 > 0, length2, 1.0)
    rest = away - np.clip(along, 0.0, 1.0)[:, :, None] * sides
    distance = np.sqrt(np.einsum("nij,nij->ni", rest, rest).min(axis=1))
    # to the plane, for points above or below the inside: all sides turn the same way around them
    normal = np.cross(sides[:, 0], sides[:, 1])
    area = np.linalg.norm(normal, axis=1)
    inside = (area > 0) & (np.einsum("nij,nj->ni", np.cross(sides, away), normal) >= 0).all(axis=1)
    height = np.abs(np.einsum("ij,ij->i", away[:, 0], normal)) / np.where(area > 0, area, 1.0)
    return np.where(inside, np.minimum(height, distance), distance)


def caster(mesh: Mesh) -> Any:
    """Open3D's ray caster with the mesh in it; its triangles keep their numbers."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(mesh.vertices.astype(np.float32)),
        o3d.core.Tensor.from_numpy(mesh.triangles.astype(np.uint32)),
    )
    return scene
