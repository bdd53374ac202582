"""How much two scans share under a transform, and which of the shifts that a cyclic one stands for is right."""

from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from spectral.prepare.prepared import Prepared

# A point has a counterpart within this distance: a voxel of either scan plus the noise between them [voxels].
_REACH = 2.0
# So many points are enough to choose among the alternatives of a shift.
_SAMPLE = 2000


def overlap(target: Prepared, source: Prepared, R_target_source: Rotation, shift: np.ndarray) -> float:
    """The share of points, one per voxel, with a counterpart in the other scan; the smaller of both directions.

    Args:
        R_target_source, shift: p_target = R p_source + shift, both about the scans' grid centers [voxels].

    Returns:
        0..1.
    """
    moved = R_target_source.apply(source.surface) + shift
    back = R_target_source.inv().apply(target.surface - shift)
    return min(share_near(target, moved), share_near(source, back))


def unwrap(target: Prepared, source: Prepared, R_target_source: Rotation, shift: np.ndarray, edge: int) -> np.ndarray:
    """The shift (3,) [voxels] that a cyclic one stands for: along each axis itself, or one edge less or more.

    The correlation repeats after `edge` voxels, so that a shift of 70 on a grid of 128 looks like one of -58. Of the
    eight alternatives the one under which most points of the source have a counterpart is right; the given one where
    none is better.
    """
    points = R_target_source.apply(source.surface[:: max(1, len(source.surface) // _SAMPLE)])
    wrapped = shift - np.copysign(edge, shift)
    alternatives = [np.array(choice) for choice in product(*zip(shift, wrapped, strict=True))]
    return max(alternatives, key=lambda alternative: share_near(target, points + alternative))


def share_near(scan: Prepared, points: np.ndarray) -> float:
    """The share of points (n, 3), 0..1, with a point of the scan within 2 voxels; about its grid's center [voxels]."""
    distance, _ = scan.tree.query(points, distance_upper_bound=_REACH)
    return float(np.isfinite(distance).mean())
