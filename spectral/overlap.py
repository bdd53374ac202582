"""How much two scans share under a transform."""

import numpy as np
from scipy.spatial.transform import Rotation

from spectral.prepared import Prepared

# A point has a counterpart within this distance: a voxel of either scan plus the noise between them [voxels].
_REACH = 2.0


def overlap(target: Prepared, source: Prepared, R_target_source: Rotation, shift: np.ndarray) -> float:
    """The share of points, one per voxel, with a counterpart in the other scan; the smaller of both ways.

    Args:
        R_target_source, shift: p_target = R p_source + shift, both about the scans' grid centers [voxels].

    Returns:
        0..1.
    """
    moved = R_target_source.apply(source.surface) + shift
    back = R_target_source.inv().apply(target.surface - shift)
    return min(_share(target, moved), _share(source, back))


def _share(scan: Prepared, points: np.ndarray) -> float:
    distance, _ = scan.tree.query(points, distance_upper_bound=_REACH)
    return float(np.isfinite(distance).mean())
