"""How much two scans share under a transform, and which of the shifts that a cyclic one stands for is right."""

from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.surface.nearest import find_nearest, upload_places
from sonarmap.spectral.prepare.prepared import Prepared

# A point has a counterpart within this distance: a voxel of either scan plus the noise between them [voxels].
_REACH = 2.0
# So many points are enough to choose among the alternatives of a shift.
_SAMPLE = 2000


def overlap(device: Device, target: Prepared, source: Prepared, R_target_source: Rotation, shift: np.ndarray) -> float:
    """The share of points, 0..1, one per voxel, with a counterpart in the other scan; the smaller of both directions.

    p_target = R p_source + shift, both about the scans' grid centers [voxels].
    """
    back = R_target_source.inv()
    there = _shares_near(device, target, source.surface, R_target_source, shift[None])[0]
    return float(min(there, _shares_near(device, source, target.surface, back, -back.apply(shift)[None])[0]))


def unwrap(
    device: Device, target: Prepared, source: Prepared, R_target_source: Rotation, shift: np.ndarray, edge: int
) -> np.ndarray:
    """The shift (3,) [voxels] that a cyclic one stands for: along each axis itself, or one edge less or more.

    The correlation repeats after `edge` voxels, so that a shift of 70 on a grid of 128 looks like one of -58. Of the
    eight alternatives the one under which most points of the source have a counterpart is right; the given one where
    none is better.
    """
    points = source.surface[:: max(1, len(source.surface) // _SAMPLE)]
    wrapped = shift - np.copysign(edge, shift)
    alternatives = np.array(list(product(*zip(shift, wrapped, strict=True))))
    return alternatives[_shares_near(device, target, points, R_target_source, alternatives).argmax()]


def _shares_near(device: Device, scan: Prepared, points: np.ndarray, R: Rotation, shifts: np.ndarray) -> np.ndarray:
    """(k,) shares of the points (n, 3), 0..1, with a point of the scan within 2 voxels under R and each of k shifts."""
    turns = np.repeat(R.as_matrix()[None], len(shifts), axis=0)
    distance, _ = find_nearest(device, scan.cells, upload_places(device, points), turns, shifts, _REACH)
    return np.isfinite(distance).mean(axis=1)
