"""From a scan's points to its plane patches."""

import numpy as np

from tools.baselines.planes.cells import Cells, sort_into_cells
from tools.baselines.planes.fit import fit_plane
from tools.baselines.planes.growing import grow
from tools.baselines.planes.patch import Patches, no_patches, tangents

# Smaller ones are too many and too uncertain to be told apart [squares of a cell's face].
_LEAST_AREA = 10
_FEWEST_POINTS = 30
# A surface's deviations from its plane hang together over about so many cells.
_BLOCK = 2.0


def extract_patches(points: np.ndarray, size: float) -> Patches:
    """The plane patches of a scan, largest first; none where there are no planes.

    Args:
        points: (N, 3) [m, sensor frame].
        size: edge of the cells in which planes are grown [m], about as large as the noise or larger.
    """
    cells = sort_into_cells(points, size)
    patches = [patch for index in _members(cells) if (patch := _patch(cells.points[index], size)) is not None]
    if not patches:
        return no_patches()
    found = Patches(*(np.array(column) for column in zip(*patches, strict=True)))
    return found.take(np.argsort(-found.area, kind="stable"))


def _members(cells: Cells) -> list[np.ndarray]:
    """The points (n,) of each region, by index."""
    regions = grow(cells)
    owner = np.full(len(cells.deviation), -1)
    for number, region in enumerate(regions):
        owner[region] = number
    owner = owner[cells.cell]
    order = np.argsort(owner, kind="stable")
    return np.split(order, np.searchsorted(owner[order], np.arange(len(regions))))[1:]


def _patch(points: np.ndarray, size: float) -> tuple | None:
    """The fields of the patch of points (N, 3) [m], or None where it is too small."""
    if len(points) < _FEWEST_POINTS:
        return None
    along = tangents(np.linalg.eigh(np.cov(points.T))[1][:, 0])[:3, :2]
    squares = np.floor(points @ along / (_BLOCK * size)).astype(np.int64)
    fit = fit_plane(points, squares[:, 0] * (1 << 32) + squares[:, 1])
    # one point per square of a cell's face: where beams lie dense a patch is no larger
    across = points[fit.kept] @ along
    faces, first = np.unique(np.floor(across / size), axis=0, return_index=True)
    if len(faces) < _LEAST_AREA:
        return None
    places = points[fit.kept][first]
    middle = places.mean(axis=0)
    middle = middle - (middle @ fit.normal - fit.distance) * fit.normal
    spread = np.cov(places.T)
    return fit.normal, fit.distance, fit.covariance, middle, spread, len(faces) * size**2, int(fit.kept.sum())
