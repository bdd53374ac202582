"""The map's surface as a mesh through its grid from above, colored by height."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.map_folder.folder import MapPart
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.files.writers.points import float32_origin
from sonarmap.tools.products.export.grid import HEIGHT_COLORS, check_size, shown_heights, top_cells


@dataclass(frozen=True, slots=True)
class Mesh:
    vertices: np.ndarray  # (V, 3) float64 [m], in the map's frame
    triangles: np.ndarray  # (T, 3) uint32, counterclockwise from outside
    colors: np.ndarray  # (V, 4) uint8, red, green, blue, opaque


def write_grid(path: Path, part: MapPart, cell: float) -> Mapping[str, Any]:
    """Write a mesh through the uppermost surface of the map's cells [m], from above. Raises InputError: no three cells
    side by side."""
    from matplotlib import colormaps

    vertices, triangles = _through_grid(part, cell)
    used, numbers = np.unique(triangles, return_inverse=True)
    if not len(used):
        raise InputError("the map's points are too far apart for a surface; give larger cells with --cell M")
    vertices = vertices[used]
    low, high = shown_heights(part.points[:, 2], part.columns["seen"])
    colors = colormaps[HEIGHT_COLORS]((vertices[:, 2] - low) / (high - low), bytes=True)
    mesh = Mesh(vertices, numbers.reshape(-1, 3).astype(np.uint32), colors)
    with atomic_path(path) as temporary:
        temporary.write_bytes(_ply(mesh) if path.suffix == ".ply" else _glb(mesh))
    counts = {"vertices": len(vertices), "triangles": len(triangles)}
    return {**counts, "surface": "through the middles of cells", "cell_m": cell}


def _through_grid(part: MapPart, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices in the middles of cells, and two triangles, or one, between four, or three."""
    place = np.floor(part.points[:, :2] / cell).astype(np.int64)
    least = place.min(axis=0)
    column, row = (place - least).T
    check_size(int(row.max()) + 1, int(column.max()) + 1, cell)
    cells = top_cells(row, column, part.points[:, 2], part.height_sigma, part.columns["count"], cell)
    middles = (np.column_stack([cells.column, cells.row]) + least + 0.5) * cell
    vertices = np.column_stack([middles, cells.height])
    width = int(cells.column.max()) + 3  # a column more at both sides, so that squares do not reach round
    keys = (cells.row + 1) * width + cells.column + 1
    squares = np.unique(keys[:, None] - [0, 1, width, width + 1])
    wanted = squares[:, None] + [0, 1, width + 1, width]  # corners, counterclockwise
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    corners = np.where(keys[at] == wanted, at, -1)
    held = (corners >= 0).sum(axis=1)
    whole, three = corners[held == 4], corners[held == 3]
    return vertices, np.concatenate([whole[:, :3], whole[:, [0, 2, 3]], three[three >= 0].reshape(-1, 3)])


def _ply(mesh: Mesh) -> bytes:
    """Binary PLY with coordinates of eight bytes."""
    vertices = np.zeros(len(mesh.vertices), [("xyz", "<f8", 3), ("rgb", "u1", 3)])
    vertices["xyz"], vertices["rgb"] = mesh.vertices, mesh.colors[:, :3]
    faces = np.zeros(len(mesh.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.triangles
    lines = ["ply", "format binary_little_endian 1.0", "comment written by sonarmap", f"element vertex {len(vertices)}"]
    lines += [f"property double {axis}" for axis in "xyz"] + [
        f"property uchar {name}" for name in ("red", "green", "blue")
    ]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    return "\n".join(lines).encode() + vertices.tobytes() + faces.tobytes()


def _glb(mesh: Mesh) -> bytes:
    """glTF 2.0 in one file, y up as it wants it: x, z, -y. Coordinates of four bytes from the node's translation."""
    import trimesh
    from trimesh.exchange.gltf import export_glb

    origin = float32_origin(mesh.vertices)
    shape = trimesh.Trimesh(
        _y_up(mesh.vertices - origin), mesh.triangles, vertex_colors=mesh.colors, process=False, validate=False
    )
    scene = trimesh.Scene()
    scene.add_geometry(shape, transform=trimesh.transformations.translation_matrix(_y_up(origin[None])[0]))
    return export_glb(scene, tree_postprocessor=_dull)


def _dull(tree: dict[str, Any]) -> None:
    """A material seen from both sides, where that of glTF itself is a mirror's front."""
    tree["materials"] = [{"pbrMetallicRoughness": {"metallicFactor": 0.0}, "doubleSided": True}]
    tree["meshes"][0]["primitives"][0]["material"] = 0


def _y_up(points: np.ndarray) -> np.ndarray:
    """(N, 3) x, y, z as glTF has them: x, z, -y."""
    return np.column_stack([points[:, 0], points[:, 2], -points[:, 1]])
