"""A scan's points in cells, and how flat the surface is about each: where planes are grown."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from slam.map.cell import cell_keys, lattice_origin

# A cell's surroundings must hold so many points for their plane to mean anything.
_FEWEST_POINTS = 10
# The surroundings of a cell, its own 3 x 3 x 3 block, must spread so far in two directions [cells].
_LEAST_SPREAD = 0.45

_OFFSETS = np.array([(x << 42) + (y << 21) + z for x, y, z in product((-1, 0, 1), repeat=3)])


@dataclass(frozen=True, slots=True)
class Cells:
    """The occupied cells of a scan, each with the plane through the points of its 3 x 3 x 3 block.

    Attributes:
        points: (N, 3) float64 [m, sensor frame], those within reach of the lattice.
        cell: (N,) which cell each point lies in.
        neighbors: (C, 27) the cells of each block, itself among them; -1 where nothing is.
        middle: (C, 3) [m] mean of each block's points.
        normal: (C, 3) unit normal of the block's plane, toward the side away from the sensor.
        deviation: (C,) [m] root mean square distance from that plane; inf where there is no plane to speak of.
        size: edge of a cell [m].
    """

    points: np.ndarray
    cell: np.ndarray
    neighbors: np.ndarray
    middle: np.ndarray
    normal: np.ndarray
    deviation: np.ndarray
    size: float


def sort_into_cells(points: np.ndarray, size: float) -> Cells:
    """Cells of edge `size` [m] from points (N, 3) [m] in the sensor frame."""
    points = points.astype(np.float64)
    origin = lattice_origin(points, size)
    keys, near = cell_keys(points, size, origin)
    points = points[near]
    unique, cell = np.unique(keys, return_inverse=True)
    neighbors = _neighbors(unique)
    count, middle, scatter = _block_moments(points, cell, neighbors)
    values, vectors = np.linalg.eigh(scatter)
    normal = vectors[:, :, 0]
    away = np.einsum("ci,ci->c", normal, middle)
    normal = normal * np.where(away < 0, -1.0, 1.0)[:, None]
    flat = (count >= _FEWEST_POINTS) & (values[:, 1] >= (_LEAST_SPREAD * size) ** 2)
    deviation = np.where(flat, np.sqrt(np.maximum(values[:, 0], 0.0)), np.inf)
    return Cells(points, cell, neighbors, middle, normal, deviation, size)


def _neighbors(keys: np.ndarray) -> np.ndarray:
    """(C, 27) indices into the sorted keys (C,), -1 where a cell is empty."""
    wanted = keys[:, None] + _OFFSETS[None, :]
    place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[place] == wanted, place, -1)


def _block_moments(
    points: np.ndarray, cell: np.ndarray, neighbors: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number (C,), mean (C, 3) and covariance (C, 3, 3) of the points of each cell's block."""
    shift = points.mean(axis=0)
    moved = points - shift
    rows, columns = np.triu_indices(3)
    terms = np.column_stack([np.ones(len(points)), moved, moved[:, rows] * moved[:, columns]])
    sums = np.column_stack([np.bincount(cell, term, minlength=len(neighbors)) for term in terms.T])
    padded = np.vstack([sums, np.zeros(sums.shape[1])])  # index -1 is an empty cell
    block = padded[neighbors].sum(axis=1)
    count = block[:, 0]
    mean = block[:, 1:4] / count[:, None]
    second = np.empty((len(count), 3, 3))
    second[:, rows, columns] = second[:, columns, rows] = block[:, 4:] / count[:, None]
    return count, mean + shift, second - mean[:, :, None] * mean[:, None, :]
