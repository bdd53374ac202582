"""Growing planes: from the flattest cell outward, as long as the surface goes on in one plane."""

import numpy as np

from tools.baselines.planes.cells import Cells

# A block rougher than this starts no plane and joins none [cells].
_ROUGHEST = 0.45
# How far the middle of a block may lie from the plane it joins [cells], and how far its normal may turn from it.
_APART = 0.4
_TURNED = float(np.cos(np.deg2rad(22.0)))
# A plane has at least so many cells.
_FEWEST_CELLS = 8


def grow(cells: Cells) -> list[np.ndarray]:
    """The planes of a scan, largest first: of each the cells that belong to it, every cell to one at most.

    Region growing as Pathak et al. do it over a range image (DOI 10.1007/s11370-009-0057-4, after Poppinga et
    al. 2008), here over cells, since the points come in no order: the flattest free cell starts a plane, whose
    neighbors join where their middles lie near the plane and their normals point its way.
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
    region = [seed]
    front = np.array([seed])
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
        middle, normal = _plane(cells, region, middle, normal)
    return np.array(region)


def _plane(cells: Cells, region: list[int], middle: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle (3,) and normal (3,) of the plane through a region's blocks; as given while it is small."""
    if len(region) < 6:
        return middle, normal
    points = cells.middle[region]
    middle = points.mean(axis=0)
    # the blocks' own normals steady the plane of a region that is still narrow
    turn = np.linalg.eigh((points - middle).T @ (points - middle))[1][:, 0]
    turn = turn * np.sign(turn @ normal)
    mean = cells.normal[region].mean(axis=0)
    share = min(1.0, len(region) / 40)
    normal = share * turn + (1 - share) * mean / np.linalg.norm(mean)
    return middle, normal / np.linalg.norm(normal)
