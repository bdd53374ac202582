"""Solids as triangle meshes: boxes, prisms, cylinders, ellipsoids, lofts and height fields."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation


def rounded(corners: np.ndarray, bend: float, pieces: int = 6) -> np.ndarray:
    """The corners (K, D) [m] with every inner one replaced by a parabola.

    It runs from `bend` [m] before the corner to `bend` behind it, or over a little less than half of a leg that is too
    short for that.
    """
    if bend <= 0 or len(corners) < 3:
        return corners
    share = np.linspace(0, 1, pieces + 1)[:, None]
    line = [corners[:1]]
    for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        reach = [min(bend, 0.45 * float(np.linalg.norm(end - corner))) for end in (before, after)]
        enter = corner + reach[0] * (before - corner) / np.linalg.norm(before - corner)
        leave = corner + reach[1] * (after - corner) / np.linalg.norm(after - corner)
        line.append((1 - share) ** 2 * enter + 2 * share * (1 - share) * corner + share**2 * leave)
    return np.concatenate([*line, corners[-1:]])


CYLINDER_SIDES = 24


@dataclass(frozen=True, slots=True)
class Mesh:
    """A surface made of triangles."""

    vertices: np.ndarray  # (V, 3) float64 [m], frame of the scene (East-North-Up)
    triangles: np.ndarray  # (T, 3) int64, indices into `vertices`; counterclockwise from outside where it is closed

    def moved(self, turn: Rotation, place: ArrayLike) -> "Mesh":
        """The mesh turned about the origin of its frame and then shifted by `place` (3,) [m]."""
        return Mesh(turn.apply(self.vertices) + np.asarray(place, float), self.triangles)


def merge(meshes: Sequence[Mesh]) -> Mesh:
    """All triangles of `meshes` in one mesh, in their order."""
    offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.triangles + offset for mesh, offset in zip(meshes, offsets, strict=False)]),
    )


def box(center: ArrayLike, size: Sequence[float] | np.ndarray, R_scene_box: Rotation | None = None) -> Mesh:
    """A box of edge lengths `size` [m] about `center`, turned by `R_scene_box`."""
    length, width, height = size
    outline = np.array([[-length, -width], [length, -width], [length, width], [-length, width]]) / 2
    upright = prism(outline, -height / 2, height / 2)
    turned = upright.vertices if R_scene_box is None else R_scene_box.apply(upright.vertices)
    return Mesh(turned + np.asarray(center, float), upright.triangles)


def prism(outline: np.ndarray, bottom: float, top: float) -> Mesh:
    """A convex polygon (K, 2), counterclockwise, extruded from height `bottom` to `top` [m], ends closed."""
    sides = len(outline)
    lower = np.column_stack([outline, np.full(sides, float(bottom))])
    upper = np.column_stack([outline, np.full(sides, float(top))])
    return loft([lower, upper])


def wall(path: ArrayLike, thickness: float, bottom: float, top: float) -> Mesh:
    """Upright slabs along the corners of `path` (K, 2) [m], one box per leg, overlapping at the corners."""
    corners = np.asarray(path, float)
    legs = []
    for start, end in pairwise(corners):
        along = end - start
        length = float(np.hypot(*along))
        middle = (*((start + end) / 2), (bottom + top) / 2)
        turn = Rotation.from_euler("z", np.arctan2(along[1], along[0]))
        legs.append(box(middle, (length + thickness, thickness, top - bottom), turn))
    return merge(legs)


def cylinder(start: ArrayLike, end: ArrayLike, radius: float, sides: int = CYLINDER_SIDES) -> Mesh:
    """A closed cylinder between the centers of its two ends [m], as a prism of `sides` sides."""
    foot, head = np.asarray(start, float), np.asarray(end, float)
    axis = (head - foot) / np.linalg.norm(head - foot)
    aside = np.cross(axis, (1.0, 0.0, 0.0) if abs(axis[0]) < 0.9 else (0.0, 1.0, 0.0))
    aside /= np.linalg.norm(aside)
    across = np.cross(axis, aside)
    angle = 2 * np.pi * np.arange(sides)[:, None] / sides
    ring = radius * (np.cos(angle) * aside + np.sin(angle) * across)
    return loft([foot + ring, head + ring])


def rod(middle: ArrayLike, reach: np.ndarray, radius: float, sides: int = CYLINDER_SIDES) -> Mesh:
    """A closed cylinder from `middle - reach` to `middle + reach` [m]."""
    return cylinder(np.asarray(middle, float) - reach, np.asarray(middle, float) + reach, radius, sides)


def ellipsoid(center: ArrayLike, radii: ArrayLike, R_scene_solid: Rotation | None = None, rings: int = 9) -> Mesh:
    """An ellipsoid of half axes `radii` [m], cut into `rings` bands of latitude."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)[1:-1, None]
    longitude = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)[None, :]
    unit = np.stack(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude) * np.ones_like(longitude),
        ],
        axis=-1,
    )
    local = (unit * np.asarray(radii, float)).reshape(-1, 3)
    turned = (R_scene_solid or Rotation.identity()).apply(local)
    return loft(list(turned.reshape(unit.shape) + np.asarray(center, float)))


def loft(sections: Sequence[np.ndarray]) -> Mesh:
    """The skin over closed sections with the same number of corners, (S, K, 3) [m], both ends closed by flat fans.

    Corners run counterclockwise as seen from the last section back to the first. The fans start from the mean
    of the corners: the end sections have to be star-shaped about it.
    """
    rings = np.asarray(sections, float)
    count, corners = rings.shape[:2]
    index = np.arange(count * corners).reshape(count, corners)
    near, near_next = index[:-1], np.roll(index, -1, axis=1)[:-1]
    far, far_next = index[1:], np.roll(index, -1, axis=1)[1:]
    foot, head = count * corners, count * corners + 1
    ends = [
        np.column_stack([np.roll(index[0], -1), index[0], np.full(corners, foot)]),
        np.column_stack([index[-1], np.roll(index[-1], -1), np.full(corners, head)]),
    ]
    skin = [
        np.stack([near, near_next, far_next], axis=-1).reshape(-1, 3),
        np.stack([near, far_next, far], axis=-1).reshape(-1, 3),
    ]
    vertices = np.concatenate([rings.reshape(-1, 3), [rings[0].mean(axis=0), rings[-1].mean(axis=0)]])
    return Mesh(vertices, np.concatenate(skin + ends))


def shell(outer: np.ndarray, inner: np.ndarray) -> Mesh:
    """A bent plate between two sheets of corners (S, K, 3) [m], its four edges closed.

    The outside of `outer` is where the cross product of the directions of its first and second index points.
    """
    count, corners = outer.shape[:2]
    index = np.arange(2 * count * corners).reshape(2, count, corners)
    # counterclockwise from outside, quad by quad: both sheets, then the strips between their edges
    sheets = [
        (index[0, :-1, :-1], index[0, 1:, :-1], index[0, 1:, 1:], index[0, :-1, 1:]),
        (index[1, :-1, :-1], index[1, :-1, 1:], index[1, 1:, 1:], index[1, 1:, :-1]),
    ]
    strips = [
        (index[0, 0, :-1], index[0, 0, 1:], index[1, 0, 1:], index[1, 0, :-1]),
        (index[0, -1, 1:], index[0, -1, :-1], index[1, -1, :-1], index[1, -1, 1:]),
        (index[0, 1:, 0], index[0, :-1, 0], index[1, :-1, 0], index[1, 1:, 0]),
        (index[0, :-1, -1], index[0, 1:, -1], index[1, 1:, -1], index[1, :-1, -1]),
    ]
    triangles = [
        np.stack([a, b, c], axis=-1).reshape(-1, 3)
        for quad in (*sheets, *strips)
        for a, b, c in (quad[:3], (quad[0], *quad[2:]))
    ]
    return Mesh(np.concatenate([outer.reshape(-1, 3), inner.reshape(-1, 3)]), np.concatenate(triangles))


def height_field(x: np.ndarray, y: np.ndarray, height: np.ndarray) -> Mesh:
    """The surface z = height[i, j] [m] over the raster x[i], y[j], two triangles a cell, seen from above."""
    east, north = np.meshgrid(x, y, indexing="ij")
    vertices = np.stack([east, north, height], axis=-1).reshape(-1, 3)
    index = np.arange(height.size).reshape(height.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    halves = [np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]
    return Mesh(vertices, np.concatenate([half.reshape(-1, 3) for half in halves]))


def tube(path: ArrayLike, radius: float, bend: float = 0.0, sides: int = 12) -> Mesh:
    """A closed round pipe along the corners of `path` (K, 3) [m], its corners rounded over `bend` [m] of either leg.

    Its rings are square to the path and do not twist from leg to leg.
    """
    line = rounded(np.asarray(path, float), bend)
    legs = np.diff(line, axis=0)
    legs /= np.linalg.norm(legs, axis=1, keepdims=True)
    along = np.concatenate([legs[:1], legs[:-1] + legs[1:], legs[-1:]])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.cross(along[0], (1.0, 0.0, 0.0) if abs(along[0][0]) < 0.9 else (0.0, 1.0, 0.0))
    angle = 2 * np.pi * np.arange(sides)[:, None] / sides
    rings = []
    for middle, axis in zip(line, along, strict=True):
        aside = aside - axis * (aside @ axis)
        aside /= np.linalg.norm(aside)
        rings.append(middle + radius * (np.cos(angle) * aside + np.sin(angle) * np.cross(axis, aside)))
    return loft(rings)
