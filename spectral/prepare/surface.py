"""The surface that a scan shows: a point for each occupied voxel, on the plane of its neighbors, with its normal."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from spectral.nearest import query_on_all_cores

# So many neighbors make a plane: enough to average noise of a voxel's size, few enough to keep edges.
_NEIGHBORS = 16
# A point farther than this from its neighbors' plane is no point of it, and stays [voxels].
_FARTHEST = 3.0


@dataclass(frozen=True, slots=True)
class Surface:
    """Points and normals of one scan, about its grid's center.

    Attributes:
        points: (m, 3) float64 [voxels].
        normals: (m, 3) float64, unit, of either sign.
        tree: to search among the points.
    """

    points: np.ndarray
    normals: np.ndarray
    tree: KDTree


def smooth_surface(points: np.ndarray, tree: KDTree) -> Surface:
    """Points (m, 3) [voxels], one a voxel, moved along the normal onto the plane of their neighbors.

    Noise along the beams stands out of the surface; registered as it is, it draws the scans together or apart.

    Args:
        points: at least 3.
        tree: of the same points.
    """
    _, nearest = query_on_all_cores(tree, points, min(_NEIGHBORS, len(points)))
    around = points[nearest]
    middle = around.mean(axis=1)
    spread = around - middle[:, None]
    _, axes = np.linalg.eigh(spread.transpose(0, 2, 1) @ spread)
    normals = np.ascontiguousarray(axes[:, :, 0])
    height = np.einsum("ni,ni->n", points - middle, normals)
    height[np.abs(height) > _FARTHEST] = 0.0
    smooth = points - height[:, None] * normals
    return Surface(smooth, normals, KDTree(smooth))
