"""From a scan's points to its plane patches: cells, planes grown over them from the flattest on, a fit to each.

Region growing as Pathak et al. do it over a range image (DOI 10.1007/s11370-009-0057-4, after Poppinga et al. 2008),
here over cells, since the points come in no order.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from sonarmap.slam.map.cell import cell_keys, lattice_origin
from sonarmap.tools.lab.baselines.planes.fit import Patches, fit_plane, tangents

# A cell's surroundings must hold so many points for their plane to mean anything.
_FEWEST_IN_BLOCK = 10
# The surroundings of a cell, its own 3 x 3 x 3 block, must spread so far in two directions [cells].
_LEAST_SPREAD = 0.45

_OFFSETS = np.array([(x << 42) + (y << 21) + z for x, y, z in product((-1, 0, 1), repeat=3)])

# A block rougher than this starts no plane and joins none [cells].
_ROUGHEST = 0.45
# How far the middle of a block may lie from the plane it joins [cells], and how far its normal may turn from it.
_APART = 0.4
_TURNED = float(np.cos(np.deg2rad(22.0)))
# A plane has at least so many cells.
_FEWEST_CELLS = 8

# Smaller ones are too many and too uncertain to be told apart [squares of a cell's face].
_LEAST_AREA = 10
_FEWEST_POINTS = 30
# A surface's deviations from its plane hang together over about so many cells.
_BLOCK = 2.0


@dataclass(frozen=True, slots=True)
class Cells:
    """The occupied cells of a scan, each with the plane through the points of its 3 x 3 x 3 block."""

    points: np.ndarray  # (N, 3) float64 [m, sensor frame], those within reach of the lattice
    cell: np.ndarray  # (N,) which cell each point lies in
    neighbors: np.ndarray  # (C, 27) the cells of each block, itself among them; -1 where nothing is
    middle: np.ndarray  # (C, 3) [m] mean of each block's points
    normal: np.ndarray  # (C, 3) unit normal of the block's plane, toward the side away from the sensor
    deviation: np.ndarray  # (C,) [m] root mean square distance from that plane; inf where there is no plane to speak of
    size: float  # edge of a cell [m]


def extract_patches(points: np.ndarray, size: float) -> Patches:
    """The plane patches of a scan, largest first; none where there are no planes.

    Args:
        points: (N, 3) [m, sensor frame].
        size: edge of the cells in which planes are grown [m], about as large as the noise or larger.
    """
    cells = sort_into_cells(points, size)
    members = (cells.points[np.isin(cells.cell, region)] for region in grow(cells))
    patches = [patch for own in members if (patch := _patch(own, size)) is not None]
    if not patches:
        return Patches(*(np.empty((0, *shape)) for shape in ((3,), (), (4, 4), (3,), (3, 3), ())))
    all_patches = Patches(*(np.array(column) for column in zip(*patches, strict=True)))
    return all_patches.take(np.argsort(-all_patches.area, kind="stable"))


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
    return fit.normal, fit.distance, fit.covariance, middle, np.cov(places.T), len(faces) * size**2


def grow(cells: Cells) -> list[np.ndarray]:
    """The planes of a scan, largest first: of each the cells that belong to it, every cell to one at most.

    The flattest free cell starts a plane, whose neighbors join where their middles lie near the plane and their
    normals point its way.
    """
    free = cells.deviation <= _ROUGHEST * cells.size
    regions = []
    for seed in np.argsort(cells.deviation, kind="stable"):
        if not free[seed]:
            continue
        region = _grow_from(int(seed), cells, free)
        free[region] = False
        if len(region) >= _FEWEST_CELLS:
            regions.append(region)
    return sorted(regions, key=len, reverse=True)


def _grow_from(seed: int, cells: Cells, free: np.ndarray) -> np.ndarray:
    """The cells (n,) that one seed's plane reaches, layer by layer; the plane is fitted anew after each."""
    asked = ~free
    asked[seed] = True
    region, front = [seed], np.array([seed])
    middle, normal = cells.middle[seed], cells.normal[seed]
    while len(front):
        near = np.unique(cells.neighbors[front])
        near = near[near >= 0]
        near = near[~asked[near]]
        # A cell that does not fit is not asked again: the plane hardly turns once it has grown.
        asked[near] = True
        apart = np.abs((cells.middle[near] - middle) @ normal) <= _APART * cells.size
        front = near[apart & (cells.normal[near] @ normal >= _TURNED)]
        region.extend(front.tolist())
        if len(region) < 6:
            continue
        points = cells.middle[region]
        middle = points.mean(axis=0)
        turn = np.linalg.eigh((points - middle).T @ (points - middle))[1][:, 0]
        # the blocks' own normals steady the plane of a region that is still narrow
        mean, share = cells.normal[region].mean(axis=0), min(1.0, len(region) / 40)
        normal = share * (turn * np.sign(turn @ normal)) + (1 - share) * mean / np.linalg.norm(mean)
        normal = normal / np.linalg.norm(normal)
    return np.array(region)


def sort_into_cells(points: np.ndarray, size: float) -> Cells:
    """Cells of edge `size` [m] from points (N, 3) [m] in the sensor frame."""
    points = points.astype(np.float64)
    keys, near = cell_keys(points, size, lattice_origin(points, size))
    points = points[near]
    unique, cell = np.unique(keys, return_inverse=True)
    wanted = unique[:, None] + _OFFSETS[None, :]
    place = np.minimum(np.searchsorted(unique, wanted), len(unique) - 1)
    neighbors = np.where(unique[place] == wanted, place, -1)
    count, middle, scatter = _block_moments(points, cell, neighbors)
    values, vectors = np.linalg.eigh(scatter)
    normal = vectors[:, :, 0]
    normal = normal * np.where(np.einsum("ci,ci->c", normal, middle) < 0, -1.0, 1.0)[:, None]
    flat = (count >= _FEWEST_IN_BLOCK) & (values[:, 1] >= (_LEAST_SPREAD * size) ** 2)
    deviation = np.where(flat, np.sqrt(np.maximum(values[:, 0], 0.0)), np.inf)
    return Cells(points, cell, neighbors, middle, normal, deviation, size)


def _block_moments(
    points: np.ndarray, cell: np.ndarray, neighbors: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number (C,), mean (C, 3) and covariance (C, 3, 3) of the points of each cell's block."""
    shift = points.mean(axis=0)
    moved = points - shift
    rows, columns = np.triu_indices(3)
    terms = np.column_stack([np.ones(len(points)), moved, moved[:, rows] * moved[:, columns]])
    sums = np.column_stack([np.bincount(cell, term, minlength=len(neighbors)) for term in terms.T])
    padded = np.vstack([sums, np.zeros(sums.shape[1])])  # index -1 is an empty cell
    block = padded[neighbors].sum(axis=1)
    count = block[:, 0]
    mean = block[:, 1:4] / count[:, None]
    second = np.empty((len(count), 3, 3))
    second[:, rows, columns] = second[:, columns, rows] = block[:, 4:] / count[:, None]
    return count, mean + shift, second - mean[:, :, None] * mean[:, None, :]
