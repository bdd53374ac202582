"""A map from above as a grid with one height per cell, also where there are walls and overhangs; and a mesh of it.

The height of a cell is that of its uppermost surface: the mean of the points within one voxel below its highest point,
weighted by 1 / sigma^2. On a bed that is the weighted mean of CUBE and BAG grids. Of several surfaces above one another
it is the shoalest, as on a chart: points at a wall's foot or below an overhang do not lower it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.map_folder.folder import MapPart
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.files.writers.points import float32_origin

MOST_CELLS = 4_000_000_000  # of a grid, with or without points: 63 km square at 1 m
HEIGHT_COLORS = "viridis"  # matplotlib's color map
_EXTREMES = (0.01, 0.99)  # quantiles of the heights at the ends of the color scale
MANY_EMPTY = 0.05  # share of empty cells among the covered ones that is acceptable
_FINE = 8  # largest radius of a morphological closing [cells]
_STRIP = 10_000_000  # cells that are closed at a time, which bounds the memory
_LEAST_SIGMA = 1e-6  # [m]


@dataclass(frozen=True, slots=True)
class Cells:
    """The cells of a grid that hold points, ordered by row, then column."""

    # row, column: (K,) int64
    row: np.ndarray
    column: np.ndarray
    height: np.ndarray  # (K,) float64 [m], positive up
    sigma: np.ndarray  # (K,) float64, standard deviation of the height [m]: the points' sigmas and their scatter
    count: np.ndarray  # (K,) float64, number of sonar points behind the height


@dataclass(frozen=True, slots=True)
class DepthGrid:
    """A north-up grid in projected coordinates or a map's frame: its K cells that hold points, and where they lie."""

    cells: Cells  # row 0 is the northernmost, column 0 the westernmost
    cell_m: float  # edge of a cell [m]
    # northing of the upper edge and easting of the left one [cells]: edges of cells lie at multiples of `cell_m`
    top: int
    left: int
    shape: tuple[int, int]  # numbers of rows and columns

    @property
    def east(self) -> np.ndarray:
        """(K,) float64 [m], easting of the cells' middles."""
        return (self.left + self.cells.column + 0.5) * self.cell_m

    @property
    def north(self) -> np.ndarray:
        """(K,) float64 [m], northing of the cells' middles."""
        return (self.top - self.cells.row - 0.5) * self.cell_m

    @property
    def depth(self) -> np.ndarray:
        """(K,) float64 [m], positive down. Its standard deviation is `cells.sigma`, its soundings are `cells.count`."""
        return -self.cells.height


def top_cells(
    row: np.ndarray, column: np.ndarray, height: np.ndarray, sigma: np.ndarray, count: np.ndarray, voxel: float
) -> Cells:
    """Uppermost surface of every cell: the points up to a voxel [m] below its highest point. The M points have row and
    column (M,) int64, not negative, height and sigma (M,) [m], and count (M,) of sonar points."""
    width = int(column.max(initial=0)) + 1
    cells, cell = np.unique(row * width + column, return_inverse=True)
    top = np.full(len(cells), -np.inf)
    np.maximum.at(top, cell, height)
    surface = height >= top[cell] - voxel
    cell, height, sigma, count = cell[surface], height[surface], sigma[surface].astype(np.float64), count[surface]

    def summed(values: np.ndarray) -> np.ndarray:
        return np.bincount(cell, values, len(cells))

    weight = weight_of(sigma)
    total = summed(weight)
    mean = top + summed(weight * (height - top[cell])) / total
    # nearby points share the errors of their poses, which do not average out
    variance = summed(weight * (sigma**2 + (height - mean[cell]) ** 2)) / total
    return Cells(cells // width, cells % width, mean, np.sqrt(variance), summed(count))


def cells_of(
    how: str,
    row: np.ndarray,
    column: np.ndarray,
    height: np.ndarray,
    sigma: np.ndarray,
    count: np.ndarray,
    voxel: float,
) -> Cells:
    """Cells with heights of the kind `how`, a name of HEIGHTS; the other arguments are those of `top_cells`."""
    if how != "shoalest":
        return top_cells(row, column, height, sigma, count, voxel if how == "top" else np.inf)
    width = int(column.max(initial=0)) + 1
    cells, cell, size = np.unique(row * width + column, return_inverse=True, return_counts=True)
    highest = np.lexsort((height, cell))[np.cumsum(size) - 1]
    deviation = sigma[highest].astype(np.float64)
    return Cells(cells // width, cells % width, height[highest], deviation, np.bincount(cell, count))


def round_cell(voxel: float) -> float:
    """Smallest of 1, 2 and 5 times a power of ten that is not below the voxel [m]."""
    power = 10.0 ** np.floor(np.log10(voxel))
    return float(next(step for step in (power, 2 * power, 5 * power, 10 * power) if step >= voxel * (1 - 1e-9)))


def default_cell(voxel: float) -> float:
    """Default edge of a cell [m]; of cells as small as a voxel a tenth would be empty, as points are voxels' means."""
    return round_cell(2 * voxel)


def empty_share(places: np.ndarray, cell: float, reach: float) -> float:
    """Share of a grid's covered cells without any of the points at `places` (M, 2) [m]. Covered are the cells of the
    morphological closing of all cells with points, by a square of twice the reach [m]."""
    coarse = max(1, int(np.ceil(reach / cell / _FINE)))  # edge of the closing's cells [cells]
    row, column = np.unique(np.floor(places / (coarse * cell)).astype(np.int64), axis=0).T
    row, column = row - row[0], column - column.min()
    side = int(reach / (coarse * cell) + 1e-9)
    rows, columns = int(row[-1]) + 1, int(column.max()) + 1 + 4 * side
    covered, strip = 0, max(1, _STRIP // columns)
    for first in range(0, rows, strip):
        here = slice(*np.searchsorted(row, [first - 2 * side, first + strip + 2 * side]))
        filled = np.zeros((strip + 4 * side, columns), np.uint8)
        filled[row[here] - first + 2 * side, column[here] + 2 * side] = 1
        closed = minimum_filter(maximum_filter(filled, 2 * side + 1), 2 * side + 1)
        covered += int(np.count_nonzero(closed[2 * side : strip + 2 * side]))
    return 1 - len(np.unique(np.floor(places / cell).astype(np.int64), axis=0)) / (covered * coarse**2)


def sufficient_cell(places: np.ndarray, cell: float, reach: float) -> float:
    """Smallest edge [m], `cell` or a larger 1, 2 or 5 times a power of ten, with an `empty_share` up to MANY_EMPTY."""
    while empty_share(places, cell, reach) > MANY_EMPTY:
        cell = round_cell(1.01 * cell)
    return cell


def weight_of(sigma: np.ndarray) -> np.ndarray:
    """(M,) float64 [1/m^2], weights of points in the mean of a cell, from their standard deviations [m]."""
    return np.maximum(sigma.astype(np.float64), _LEAST_SIGMA) ** -2


def check_size(rows: int, columns: int, cell: float) -> None:
    """Refuse a grid with more than MOST_CELLS cells."""
    if rows * columns > MOST_CELLS:
        raise InputError(
            f"a grid with cells of {cell:g} m has more than {MOST_CELLS:,} of them; give larger ones with --cell M"
        )


def shown_heights(height: np.ndarray, seen: np.ndarray) -> tuple[float, float]:
    """Lower and upper end of the color scale [m], for points with height (M,) [m] and the number of scans (M,) that saw
    them; points that only one scan saw are ignored unless there are no others."""
    height = height[seen >= 2] if (seen >= 2).any() else height
    low, high = np.quantile(height, _EXTREMES).tolist()
    return (low, high) if high > low else (low - 0.5, high + 0.5)


@dataclass(frozen=True, slots=True)
class Mesh:
    vertices: np.ndarray  # (V, 3) float64 [m], in the map's frame
    triangles: np.ndarray  # (T, 3) uint32, counterclockwise from outside
    colors: np.ndarray  # (V, 4) uint8, red, green, blue, opaque


def write_mesh(path: Path, part: MapPart, cell: float) -> Mapping[str, Any]:
    """Write a mesh of the uppermost surface of the map's cells [m] as PLY or GLB; return the side-car's details."""
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
    """Vertices in the middles of cells; two triangles between four neighboring cells, one between three."""
    place = np.floor(part.points[:, :2] / cell).astype(np.int64)
    least = place.min(axis=0)
    column, row = (place - least).T
    check_size(int(row.max()) + 1, int(column.max()) + 1, cell)
    cells = top_cells(row, column, part.points[:, 2], part.height_sigma, part.columns["count"], cell)
    middles = (np.column_stack([cells.column, cells.row]) + least + 0.5) * cell
    vertices = np.column_stack([middles, cells.height])
    width = int(cells.column.max()) + 3  # with an empty column at both sides, so that squares do not wrap around
    keys = (cells.row + 1) * width + cells.column + 1
    squares = np.unique(keys[:, None] - [0, 1, width, width + 1])
    wanted = squares[:, None] + [0, 1, width + 1, width]  # corners, counterclockwise
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    corners = np.where(keys[at] == wanted, at, -1)
    filled = (corners >= 0).sum(axis=1)
    whole, three = corners[filled == 4], corners[filled == 3]
    return vertices, np.concatenate([whole[:, :3], whole[:, [0, 2, 3]], three[three >= 0].reshape(-1, 3)])


def _ply(mesh: Mesh) -> bytes:
    """Binary PLY with float64 coordinates."""
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
    """Binary glTF 2.0, y up as the format requires, with float32 coordinates from the node's translation."""
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
    """Set a dull material visible from both sides; glTF's default is a mirror visible from the front."""
    tree["materials"] = [{"pbrMetallicRoughness": {"metallicFactor": 0.0}, "doubleSided": True}]
    tree["meshes"][0]["primitives"][0]["material"] = 0


def _y_up(points: np.ndarray) -> np.ndarray:
    """(N, 3) points in glTF's axes: x, z, -y."""
    return np.column_stack([points[:, 0], points[:, 2], -points[:, 1]])
