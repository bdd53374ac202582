"""A scene: one mesh to cast rays at, and the table of scenes that can be built from a seed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from kernels.errors import InputError
from tools.simulate.clutter import clutter
from tools.simulate.floodgate import floodgate
from tools.simulate.harbor import harbor
from tools.simulate.solids import Mesh

SCENES: MappingProxyType[str, Callable[[int], Mesh]] = MappingProxyType(
    {"floodgate": floodgate, "harbor": harbor, "clutter": clutter}
)


@dataclass(frozen=True)
class Scene:
    """A world to look at: about 256 m on a side, centered, z up, the water's surface at z = 0.

    Attributes:
        name: which scene, a key of SCENES or a name of the caller's.
        mesh: its surface, East-North-Up [m].
    """

    name: str
    mesh: Mesh

    def intersect(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nearest surface along rays.

        Args:
            origins: (N, 3) [m].
            directions: (N, 3) unit vectors.

        Returns:
            (N,) float64 ranges [m], inf where a ray meets nothing, and (N,) sines of grazing angles, 0..1.

        Open3D's ray caster says which triangle a ray meets; the point on its plane is then computed in
        float64, so that the range is exact and does not depend on the machine's vector unit.
        """
        import open3d as o3d

        rays = np.concatenate([origins, directions], axis=1).astype(np.float32)
        found = self._caster.cast_rays(o3d.core.Tensor.from_numpy(rays))["primitive_ids"].numpy()
        met = np.flatnonzero(found != o3d.t.geometry.RaycastingScene.INVALID_ID)
        corner = self.mesh.vertices[self.mesh.triangles[found[met].astype(np.int64)]]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        closing = np.einsum("ij,ij->i", normal, directions[met])
        distance = np.einsum("ij,ij->i", normal, corner[:, 0] - origins[met])
        ranges = np.full(len(origins), np.inf)
        sine_grazing = np.zeros(len(origins))
        ranges[met] = np.divide(distance, closing, out=np.full(len(met), np.inf), where=closing != 0)
        sine_grazing[met] = np.minimum(np.abs(closing), 1.0)
        return ranges, sine_grazing

    @cached_property
    def _caster(self) -> Any:
        import open3d as o3d

        caster = o3d.t.geometry.RaycastingScene()
        caster.add_triangles(
            o3d.core.Tensor.from_numpy(self.mesh.vertices.astype(np.float32)),
            o3d.core.Tensor.from_numpy(self.mesh.triangles.astype(np.uint32)),
        )
        return caster


@lru_cache(maxsize=4)
def build_scene(name: str, seed: int) -> Scene:
    """The scene `name` of SCENES built from `seed`: the same seed, the same surface."""
    if name not in SCENES:
        raise InputError(f"no scene is called {name!r}; there are {', '.join(SCENES)}")
    return Scene(name, SCENES[name](seed))
