"""The surface that a scan shows: a point for each occupied voxel, on the plane of its neighbors, with its normal."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from spectral.nearest import query_on_all_cores

# So many neighbors make a plane: enough to average noise of a voxel's size, few enough to keep edges.
_NEIGHBORS = 16
# A point farther than this from its neighbors' plane is no point of it, and stays [voxels].
_FARTHEST = 3.0
# At a rim the neighbors lie to one side: their middle is farther away than this share of their spread. On a straight
# rim it is three quarters, well inside a fifth.
_ASIDE = 0.4
# A direction of normals that holds a smaller share of the points than this counts less than the others.
_RARE = 0.05

# The tree's leaves, for the shortest queries: most points have their counterpart at hand.
_LEAF = 32


def _hemisphere(count: int) -> np.ndarray:
    """(count, 3) unit vectors of z above 0, about evenly apart: a spiral of golden angles."""
    k = np.arange(count)
    z = (k + 0.5) / count
    angle = k * np.pi * (3 - np.sqrt(5))
    return np.column_stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z])


# Normals are counted by the nearest of these, of either sign: some 25 degrees apart.
_DIRECTIONS = _hemisphere(26)


@dataclass(frozen=True, slots=True)
class Surface:
    """Points and normals of one scan, about its grid's center.

    Attributes:
        points: (m, 3) float64 [voxels].
        normals: (m, 3) float64, unit, of either sign.
        tree: to search among the points.
        inner: (m,) bool, which have neighbors on all sides; the others lie at a rim of what the scan shows.
        weights: (m,) float64, of mean 1: the less of the surface faces a point's direction, the more it counts. On a
            wide bed a few walls fix where a scan lies.
        rays: (m, 3) float64, to each point from where the sensor saw it [voxels]; 0 where that is not known.
    """

    points: np.ndarray
    normals: np.ndarray
    tree: KDTree
    inner: np.ndarray
    weights: np.ndarray
    rays: np.ndarray


def smooth_surface(points: np.ndarray, tree: KDTree, viewpoints: Sequence[np.ndarray] = ()) -> Surface:
    """Points (m, 3) [voxels], one a voxel, moved along the normal onto the plane of their neighbors.

    Noise along the beams stands out of the surface; registered as it is, it draws the scans together or apart.

    Args:
        points: at least 3.
        tree: of the same points.
        viewpoints: (3,) each, where the sensor was [voxels]: it saw a point from the nearest of them.
    """
    _, nearest = query_on_all_cores(tree, points, min(_NEIGHBORS, len(points)))
    around = points[nearest]
    middle = around.mean(axis=1)
    spread = around - middle[:, None]
    squares, axes = np.linalg.eigh(spread.transpose(0, 2, 1) @ spread)
    normals = np.ascontiguousarray(axes[:, :, 0])
    height = np.einsum("ni,ni->n", points - middle, normals)
    height[np.abs(height) > _FARTHEST] = 0.0
    smooth = points - height[:, None] * normals
    aside = ((middle - smooth) ** 2).sum(axis=1)
    inner = aside <= _ASIDE**2 * squares[:, 1:].sum(axis=1) / nearest.shape[1]
    return Surface(
        smooth,
        normals,
        KDTree(smooth, _LEAF, compact_nodes=False, balanced_tree=False),
        inner,
        _balanced(normals),
        _rays(smooth, viewpoints),
    )


def _balanced(normals: np.ndarray) -> np.ndarray:
    """(m,) weights of mean 1 under which all directions of normals count alike, but for rare ones."""
    direction = np.abs(normals @ _DIRECTIONS.T).argmax(axis=1)
    share = np.bincount(direction, minlength=len(_DIRECTIONS)) / len(normals)
    weights = 1.0 / (share[direction] + _RARE)
    return weights / weights.mean()


def _rays(points: np.ndarray, viewpoints: Sequence[np.ndarray]) -> np.ndarray:
    """(m, 3) to the points from the nearest viewpoints; 0 without any."""
    if not len(viewpoints):
        return np.zeros_like(points)
    places = np.array(viewpoints)
    _, nearest = KDTree(places).query(points)
    return points - places[nearest]
