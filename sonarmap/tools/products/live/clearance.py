"""Distances that a pilot reads: to the bed below the vehicle, and to the nearest wall ahead."""

import numpy as np

_FEWEST = 4  # echoes of a surface, at least; fewer may be stray
_NARROWEST = 0.5  # radius of the tube in which a surface is looked for [m]
_WIDTH = 2.0  # the same [voxels]


def clearance(points: np.ndarray, direction: np.ndarray, voxel: float) -> float | None:
    """Distance along a unit vector from the origin to the nearest surface of points (N, 3) [m] in a tube around it;
    None without one."""
    radius = max(_NARROWEST, _WIDTH * voxel)
    along = points @ direction
    aside = np.linalg.norm(points - along[:, None] * direction, axis=1)
    inside = np.sort(along[(along > 0) & (aside < radius)])
    surfaces = np.flatnonzero(inside[_FEWEST - 1 :] - inside[: 1 - _FEWEST] < radius)
    return float(np.median(inside[surfaces[0] :][:_FEWEST])) if len(surfaces) else None
