"""Distances that a pilot reads: to the bed below the vehicle, and to the nearest wall ahead."""

import numpy as np

_FEWEST, _SHARE = 4, 0.25  # echoes of a surface, at least: a number, and a share of the beams that would meet it
_NARROWEST, _WIDTH = 0.5, 2.0  # radius of the tube in which a surface is looked for: [m], or [voxels] if that is more


def clearance(points: np.ndarray, direction: np.ndarray, voxel: float) -> float | None:
    """Distance [m] along a unit vector to the nearest surface of points (N, 3) [m] from the origin; None without."""
    radius = max(_NARROWEST, _WIDTH * voxel)
    points = points[points @ direction > 0]
    along = points @ direction
    aside = np.linalg.norm(points - along[:, None] * direction, axis=1)
    inside = np.sort(along[aside < radius])
    echoes = np.searchsorted(inside, inside + radius) - np.arange(len(inside))  # from each one on
    beams = np.searchsorted(np.sort(aside / along), radius / inside)
    surfaces = np.flatnonzero(echoes >= np.maximum(_FEWEST, _SHARE * beams))
    return float(np.median(inside[surfaces[0] :][: echoes[surfaces[0]]])) if len(surfaces) else None
