"""Which scans occupy the same cells under given poses."""

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.map.cell import cell_keys, cell_means, lattice_origin
from sonarmap.spectral.scan import Scan

# Scans that are compared with all others at a time; bounds the memory.
_TOGETHER = 500


def outline(scan: Scan, cell: float) -> np.ndarray:
    """(K, 3) float64 [m, sensor frame]: one point for every eighth of a cell that the scan occupies, their mean."""
    return cell_means(scan.points, cell / 2)


def overlapping(
    outlines: Sequence[np.ndarray], T_world_sensor: RigidTransform, cell: float, least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Scans that share cells: (m, 2) int64, i < j in order, and (m,) float64 the share, 0..1, the smaller of both ways.

    Points a million cells away from the first scan, stray echoes, do not count.

    Args:
        outlines: of N scans, (K, 3) each [m, sensor frame].
        T_world_sensor: their poses as estimated, in one frame.
        cell: edge of a cell [m].
        least: smallest share of a pair that counts, above 0.
    """
    origin = lattice_origin(T_world_sensor[0].apply(outlines[0]), cell)
    occupied = [
        np.unique(cell_keys(T.apply(points), cell, origin)[0])
        for points, T in zip(outlines, T_world_sensor, strict=True)
    ]
    counts = np.array([len(cells) for cells in occupied])
    names, column = np.unique(np.concatenate(occupied), return_inverse=True)
    row = np.repeat(np.arange(len(outlines)), counts)
    incidence = sparse.csr_array((np.ones(len(row)), (row, column)), shape=(len(outlines), len(names)))
    columns = incidence.T.tocsr()
    pairs, shares = [np.empty((0, 2), np.int64)], [np.empty(0)]
    for start in range(0, len(outlines), _TOGETHER):
        common = sparse.coo_array(incidence[start : start + _TOGETHER] @ columns)
        i, j = common.row + start, common.col
        share = common.data / np.maximum(np.maximum(counts[i], counts[j]), 1)
        chosen = (i < j) & (share >= least)
        pairs.append(np.column_stack([i[chosen], j[chosen]]).astype(np.int64))
        shares.append(share[chosen])
    both, share = np.concatenate(pairs), np.concatenate(shares)
    order = np.lexsort((both[:, 1], both[:, 0]))
    return both[order], share[order]
