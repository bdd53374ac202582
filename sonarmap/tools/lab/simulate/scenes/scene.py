"""A built scene: one mesh, and the rays that are cast at it."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from sonarmap.tools.lab.simulate.scenes.catalog import SceneKind, scene_kind
from sonarmap.tools.lab.simulate.scenes.solids import Mesh


def surface_distance(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Unsigned distances (N,) float64 [m] of the points (N, 3) from the nearest triangle of the mesh.

    Open3D finds the nearest triangle; the distance from it is then computed in float64, so that it is exact and does
    not depend on the processor.
    """
    import open3d as o3d

    places = np.asarray(points, np.float64)
    if len(places) == 0:
        return np.empty(0)
    query = o3d.core.Tensor.from_numpy(np.ascontiguousarray(places, np.float32))
    nearest = caster(mesh).compute_closest_points(query)["primitive_ids"].numpy().astype(np.int64)
    return triangle_distance(mesh.vertices[mesh.triangles[nearest]], places)


def triangle_distance(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distances (N,) [m] of points (N, 3) from one triangle each (N, 3, 3), which may be a line or a point."""
    sides = np.roll(corners, -1, axis=1) - corners
    away = points[:, None, :] - corners
    # to the sides: the foot of the perpendicular, limited to the side
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
    """Open3D's ray caster for the mesh, with the same indices of triangles."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(mesh.vertices.astype(np.float32)),
        o3d.core.Tensor.from_numpy(mesh.triangles.astype(np.uint32)),
    )
    return scene


# Direction of the rays that tell inside from outside: upward, but along no edge of a builder's meshes
UPWARD = np.array([0.0312, 0.0471, 1.0]) / np.linalg.norm([0.0312, 0.0471, 1.0])


@dataclass(frozen=True)
class Scene:
    """A built scene: centered in x and y, z up, the water's surface at z = 0."""

    name: str  # a key of SCENE_KINDS, or any name for another mesh
    mesh: Mesh  # its surface, East-North-Up [m]

    def intersect(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nearest surface along rays from `origins` (N, 3) [m] in unit `directions` (N, 3): (N,) float64 ranges
        [m], inf where a ray meets nothing, and (N,) sines of grazing angles, 0..1."""
        ranges, normals = self.intersect_with_normals(origins, directions)
        return ranges, np.minimum(np.abs(np.einsum("ij,ij->i", normals, directions)), 1.0)

    def intersect_with_normals(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `intersect`, but with (N, 3) unit normals of the surfaces, zeros where a ray meets nothing.

        Open3D's ray caster finds the triangle that a ray meets; the point on its plane is then computed in float64, so
        that the range is exact and does not depend on the processor.
        """
        import open3d as o3d

        rays = np.concatenate([origins, directions], axis=1).astype(np.float32)
        hits = self._caster.cast_rays(o3d.core.Tensor.from_numpy(rays))["primitive_ids"].numpy()
        met = np.flatnonzero(hits != o3d.t.geometry.RaycastingScene.INVALID_ID)
        corner, normal = self._planes(hits[met].astype(np.int64))
        closing = np.einsum("ij,ij->i", normal, directions[met])
        distance = np.einsum("ij,ij->i", normal, corner[:, 0] - origins[met])
        ranges, normals = np.full(len(origins), np.inf), np.zeros((len(origins), 3))
        ranges[met] = np.divide(distance, closing, out=np.full(len(met), np.inf), where=closing != 0)
        normals[met] = normal
        return ranges, normals

    @property
    def kind(self) -> SceneKind:
        """Its row of SCENE_KINDS. Raises InputError: it has none."""
        return scene_kind(self.name)

    def is_solid(self, places: np.ndarray) -> np.ndarray:
        """Whether places (N, 3) [m] lie within a solid or under the bed, (N,) bool.

        Counts the surfaces that a ray upward leaves minus those that it enters, as solids may overlap.
        """
        import open3d as o3d

        rays = np.concatenate([places, np.broadcast_to(UPWARD, places.shape)], axis=1).astype(np.float32)
        met = self._caster.list_intersections(o3d.core.Tensor.from_numpy(rays))
        _, normal = self._planes(met["primitive_ids"].numpy().astype(np.int64))
        leaving = np.bincount(met["ray_ids"].numpy(), weights=np.sign(normal @ UPWARD), minlength=len(places))
        return leaving > 0.5

    def _planes(self, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corners (N, 3, 3) [m] and unit normals (N, 3) of triangles, given their indices."""
        corner = self.mesh.vertices[self.mesh.triangles[triangles]]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        return corner, normal / np.linalg.norm(normal, axis=1, keepdims=True)

    @cached_property
    def _caster(self) -> Any:
        return caster(self.mesh)


@lru_cache(maxsize=4)
def build_scene(name: str, seed: int) -> Scene:
    """Build the scene `name` of SCENE_KINDS from `seed`, or take it from the cache. Raises InputError: there is no such
    scene."""
    return Scene(name, scene_kind(name).build(seed))
