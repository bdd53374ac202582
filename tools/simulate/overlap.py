"""How much of one scan another one saw, the truth between them known."""

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

OVERLAP_RADIUS = 2.0  # [m]


def overlap(
    target: np.ndarray, source: np.ndarray, T_target_source: RigidTransform, radius: float = OVERLAP_RADIUS
) -> float:
    """The share of the source's points that have a point of the target within `radius`, 0..1.

    Args:
        target, source: (M, 3) and (N, 3) points [m], each in its own sensor frame.
        T_target_source: the truth.
        radius: [m].
    """
    distance, _ = KDTree(target).query(T_target_source.apply(source), distance_upper_bound=radius)
    return float(np.isfinite(distance).mean())


def mutual_overlap(
    target: np.ndarray, source: np.ndarray, T_target_source: RigidTransform, radius: float = OVERLAP_RADIUS
) -> float:
    """The smaller of both ways' overlaps, as Registration.overlap means it."""
    return min(
        overlap(target, source, T_target_source, radius),
        overlap(source, target, T_target_source.inv(), radius),
    )
