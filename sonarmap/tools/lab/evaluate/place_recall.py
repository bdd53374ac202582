"""How often a revisited place is found by what scans look like alone."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.map.cell import outline, overlapping
from sonarmap.spectral.scan import Scan

# A revisit shares this much with the scan, by the true poses, and was not taken within so many scans of it.
OVERLAP, GAP = 0.4, 5
AMONG = (1, 5, 10)


def revisits(scans: Sequence[Scan], truth: RigidTransform, voxel: float) -> np.ndarray:
    """(N, N) bool, whether two scans see one place again.

    Args:
        scans: N scans, in the order in which they were taken.
        truth: their N true poses.
        voxel: edge of the survey's voxels [m].
    """
    cell = LoopSettings().cell_voxels * voxel
    pairs, _ = overlapping([outline(scan, cell) for scan in scans], truth, cell, OVERLAP)
    i, j = pairs[pairs[:, 1] - pairs[:, 0] > GAP].T
    again = np.zeros((len(scans), len(scans)), bool)
    again[i, j] = again[j, i] = True
    return again


def recall(index: np.ndarray, again: np.ndarray) -> list[float]:
    """Of the scans with a revisit the share of which one is among the first 1, 5 and 10; NaN where no scan has one.

    Args:
        index: (N, 10) the scans most alike to each, best first, -1 where there are no more.
        again: (N, N) bool, see `revisits`.
    """
    right = hits(index, again)
    return [float(right[:, :k].any(axis=1).mean()) if len(right) else float("nan") for k in AMONG]


def hits(index: np.ndarray, again: np.ndarray) -> np.ndarray:
    """(M, 10) bool, whether these are revisits, of the M scans that have one."""
    right = np.take_along_axis(again, np.maximum(index, 0), axis=1) & (index >= 0)
    return right[again.any(axis=1)]
