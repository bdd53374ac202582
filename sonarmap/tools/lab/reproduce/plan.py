"""The true plan of a scene at one height, cut from the mesh: what is solid there, its outlines, and drawing them."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.tools.lab.simulate.scenes.bed import SCENE_EDGE
from sonarmap.tools.lab.simulate.shapes.solids import Mesh
from sonarmap.tools.lab.simulate.shapes.surface import caster

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CELL = 0.5  # of the raster [m]


@dataclass(frozen=True, slots=True)
class SectionPlan:
    """A horizontal section."""

    height: float  # z of the section [m]
    # (S, 2, 2) [m], the straight pieces along which the surface meets the section: ends, then x and y
    outlines: np.ndarray
    # (K, K) bool, [i, j] for the cell at x index i and y index j, whether it lies inside something solid
    solid: np.ndarray
    edge: float  # side of the raster [m], centered at the origin


def plan(mesh: Mesh, height: float) -> SectionPlan:
    """The section of a closed or bottomless scene at a height [m]."""
    return SectionPlan(height, outlines(mesh, height), solid(mesh, height), SCENE_EDGE)


def outlines(mesh: Mesh, height: float) -> np.ndarray:
    """(S, 2, 2) [m]: where triangles that reach from below `height` to it or above are cut."""
    corners = mesh.vertices[mesh.triangles]
    above = corners[:, :, 2] >= height
    cut = corners[above.any(axis=1) & ~above.all(axis=1)]
    start, end = cut, np.roll(cut, -1, axis=1)
    rise = end[:, :, 2] - start[:, :, 2]
    crossed = (start[:, :, 2] >= height) != (end[:, :, 2] >= height)  # two of three sides, always
    share = (height - start[:, :, 2]) / np.where(crossed, rise, 1.0)
    places = start[:, :, :2] + share[:, :, None] * (end - start)[:, :, :2]
    return places[crossed].reshape(-1, 2, 2)


def solid(mesh: Mesh, height: float, edge: float = SCENE_EDGE, cell: float = CELL) -> np.ndarray:
    """(K, K) bool: which cells of a raster lie inside a solid or under the ground.

    Above what is inside, more surfaces are left than entered: triangles are counterclockwise from outside, and solids
    may overlap.
    """
    import open3d as o3d

    count = round(edge / cell)
    # not quite the middles of the cells: builders lay walls along round numbers, where rays would graze them
    places = (np.arange(count) + 0.5) * cell - edge / 2 + 0.013
    x, y = (axis.ravel() for axis in np.meshgrid(places, places, indexing="ij"))
    up = np.tile(np.array([0.0, 0.0, 1.0]), (len(x), 1))
    rays = np.column_stack([x, y, np.full(len(x), height), up]).astype(np.float32)
    met = caster(mesh).list_intersections(o3d.core.Tensor.from_numpy(rays))
    corners = mesh.vertices[mesh.triangles[met["primitive_ids"].numpy().astype(np.int64)]]
    upward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    left = np.bincount(met["ray_ids"].numpy().astype(np.int64), np.sign(upward), len(x))
    return (left > 0).reshape(count, count)


_SOLID = "0.72"
OUTLINE: dict[str, Any] = {"color": "black", "linewidth": 0.6}


def draw_plan(axes: "Axes", plan: SectionPlan, *, filled: bool = True) -> None:
    """The plan's solids in gray where `filled`, and its outlines over whatever was drawn before."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap

    half = plan.edge / 2
    if filled:
        shown = np.ma.masked_equal(plan.solid.T.astype(np.uint8), 0)
        colors = ListedColormap([_SOLID])
        axes.imshow(shown, origin="lower", extent=(-half, half, -half, half), cmap=colors, interpolation="nearest")
    axes.add_collection(LineCollection(list(plan.outlines), **OUTLINE, zorder=4))


def from_above(points: np.ndarray, values: np.ndarray, edge: float, cell: float) -> np.ndarray:
    """What is seen of points, (N, 3) [m], from above: the values of the highest point of each cell, of (N,) values.

    (K, K) float64, [i, j] at x index i and y index j, NaN where there is none, for a square about the origin with sides
    of `edge` [m] and cells with sides of `cell` [m].
    """
    count = round(edge / cell)
    i, j = np.floor((points[:, :2] + edge / 2) / cell).astype(int).T
    within = (i >= 0) & (i < count) & (j >= 0) & (j < count)
    order = np.flatnonzero(within)[np.argsort(points[within, 2], kind="stable")]
    seen = np.full((count, count), np.nan)
    seen[i[order], j[order]] = values[order]  # of cells named twice the last stays: the highest
    return seen
