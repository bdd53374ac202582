"""Points sorted into large tiles, so that those near a place are found without looking at all of them."""

from dataclasses import dataclass

import numpy as np

from sonarmap.slam.map.cell import cell_keys, lattice_origin


@dataclass(frozen=True, slots=True)
class Tiles:
    """Points by the tile that they lie in.

    Attributes:
        points: (M, 3) float64 [m].
        size: edge of a tile [m].
        origin: (3,) [m], a corner of the tiles' lattice.
        names: (K,) int64, the numbers of the tiles that hold points, ascending.
        first: (K + 1,) where each tile's points begin in `order`.
        order: (M,) int, the points by tile, and within a tile as they were.
    """

    points: np.ndarray
    size: float
    origin: np.ndarray
    names: np.ndarray
    first: np.ndarray
    order: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, size: float) -> "Tiles":
        """Of (M, 3) points, in tiles of an edge of `size` [m]; points a million tiles away are in none."""
        origin = lattice_origin(points, size)
        keys, near = cell_keys(points, size, origin)
        order = np.argsort(keys, kind="stable")
        names, first = np.unique(keys[order], return_index=True)
        return cls(points, size, origin, names, np.append(first, len(keys)), np.flatnonzero(near)[order])

    def within(self, center: np.ndarray, radius: float) -> np.ndarray:
        """(m,) the points nearer to a center (3,) than this [m], ascending."""
        low, high = (np.floor((center - self.origin + side) / self.size) for side in (-radius, radius))
        axes = [np.arange(a, b + 1) for a, b in zip(low, high, strict=True)]
        corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        keys, _ = cell_keys((corners + 0.5) * self.size, self.size, np.zeros(3))
        place = np.searchsorted(self.names, keys)
        place = place[self.names[np.minimum(place, len(self.names) - 1)] == keys]
        inside = [self.order[self.first[k] : self.first[k + 1]] for k in place.tolist()]
        chosen = np.sort(np.concatenate(inside)) if inside else np.zeros(0, np.intp)
        away = self.points[chosen] - center
        return chosen[np.einsum("ij,ij->i", away, away) < radius**2]
