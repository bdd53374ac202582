"""Surfaces: the nearest points of another, and the planes of neighbors. What is searched is sorted beforehand."""

import numpy as np
from scipy.spatial import KDTree

from sonarmap.kernels.surface.cells import sort_into_cells
from sonarmap.kernels.surface.nearest import find_nearest, upload_places
from sonarmap.kernels.surface.planes import NEIGHBORS, fit_planes
from sonarmap.tools.lab.bench import twins
from sonarmap.tools.lab.bench.case import KernelCase
from sonarmap.tools.lab.bench.traffic import Traffic
from sonarmap.tools.lab.bench.workload import SMALL_SHIFT, SMALL_TURN, Workload

# Of neighbors equally far one or the other makes the plane, and the point moves by a thousandth of a voxel.
_EQUALLY_FAR = 1e-4
_FARTHEST = 2.0
# Distances of a voxel between numbers of a hundred voxels, in single precision.
_DISTANCE = 1e-5
# Bytes of a point among its cells, and of what is known of it.
_POINT, _ELEMENT = 16, 48


def nearest_case(w: Workload) -> KernelCase:
    cells, places = sort_into_cells(w.device, w.surface), upload_places(w.device, w.surface)
    tree, found = KDTree(w.surface), []

    def run() -> None:
        found[:] = find_nearest(w.device, cells, places, SMALL_TURN[None], SMALL_SHIFT[None], w.edge)

    return KernelCase(
        "find_nearest",
        "scipy.spatial.KDTree",
        Traffic(2 * _POINT * len(w.surface), 8 * len(w.surface)),
        _DISTANCE,
        run=run,
        read=lambda: found[0][0],
        twin=lambda: twins.nearest(tree, w.surface, SMALL_TURN, SMALL_SHIFT, w.cores),
    )


def planes_case(w: Workload) -> KernelCase:
    cells, tree, found = sort_into_cells(w.device, w.surface), KDTree(w.surface), []

    def run() -> None:
        found[:] = [fit_planes(w.device, cells, np.eye(3), np.empty((0, 3)), farthest=_FARTHEST, aside=1.0)]

    return KernelCase(
        "fit_planes",
        "scipy.spatial.KDTree, eigh",
        Traffic(_POINT * len(w.surface), _ELEMENT * len(w.surface)),
        _EQUALLY_FAR,
        run=run,
        read=lambda: found[0].get()[:, :3],
        twin=lambda: twins.on_planes(tree, w.surface, NEIGHBORS, _FARTHEST, w.cores),
    )
