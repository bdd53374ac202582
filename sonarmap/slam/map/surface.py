"""Separation of a map's surface points from stray echoes, by density as in DBSCAN.

Connected points with enough neighbors each are a surface, and so are the points linked to them (Ester, Kriegel, Sander
and Xu, KDD 1996). Echoes at random ranges have few neighbors or form small clumps.
"""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

_NEIGHBORS = 4  # that a point of a surface has within the radius
_MIN_POINTS = 12  # of a connected surface
_RADIUS_VOXELS = 2.0
_RADIUS_SPACINGS = 1.5  # times the median distance of the last neighbor, where voxels are finer than beams


def on_surface(points: np.ndarray, voxel: float) -> np.ndarray:
    """(M,) bool: which of a map's points (M, 3) [m] are part of a surface; all where none would be."""
    if len(points) <= _NEIGHBORS:
        return np.ones(len(points), bool)
    distance, near = KDTree(points).query(points, _NEIGHBORS + 1)
    distance, near = np.asarray(distance)[:, 1:], np.asarray(near)[:, 1:]  # the first is itself
    linked = distance <= _reach(distance[:, -1], voxel)
    dense = np.asarray(linked.all(axis=1))
    row, column = np.nonzero(dense[:, None] & dense[near])
    pairs = (np.ones(len(row), bool), (row, near[row, column]))
    group = connected_components(sparse.coo_array(pairs, shape=(len(points),) * 2), directed=False)[1]
    kept = dense & (np.bincount(group[dense], minlength=int(group.max()) + 1)[group] >= _MIN_POINTS)
    kept |= (linked & kept[near]).any(axis=1)
    return kept if kept.any() else np.ones(len(points), bool)


def surface_reach(points: np.ndarray, voxel: float) -> float:
    """Largest distance [m] between neighbors on a surface, from points (M, 3) [m] on it."""
    if len(points) <= _NEIGHBORS:
        return _RADIUS_VOXELS * voxel
    return _reach(np.asarray(KDTree(points).query(points, _NEIGHBORS + 1)[0])[:, -1], voxel)


def _reach(fourth: np.ndarray, voxel: float) -> float:
    return max(_RADIUS_VOXELS * voxel, _RADIUS_SPACINGS * float(np.median(fourth)))
