"""Candidates for loop closures: by the estimate and its uncertainty, or by the scans' signatures."""

from collections import defaultdict
from collections.abc import Container, Sequence

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.candidates.places import PlaceIndex
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.map.cell import cell_keys, overlapping
from sonarmap.slam.map.placed import pose_variance
from sonarmap.slam.pair import Candidate

_NARROW = 1 / 3  # least overlap of scans that instruments measured, as a share of that of others
_LOOKALIKES = 3  # neighbors that are looked up per wanted one, since consecutive scans show the same place
# Standard normal draws for samples of the relative pose of two scans; fixed, so that results are reproducible.
_DRAWS = np.random.default_rng(0).standard_normal((12, 6))


def find_candidates(
    outlines: Sequence[np.ndarray],
    solution: Solution,
    voxel: float,
    settings: LoopSettings,
    left_out: Container[tuple[int, int]] = frozenset(),
    unsure: bool = False,
) -> list[Candidate]:
    """Candidates for loops whose scans are expected to overlap, best first within the limits.

    They are ranked by the expected overlap, that at the estimate times its certainty by the joint marginal of both
    poses, and by the number of edges between the scans: drift grows with it, so loops between distant scans add most
    information, and those between neighbors repeat the chain's. Only scans of one component are compared.

    Args:
        outlines: of the solution's N scans, as `outline` gives them for the settings' cells.
        left_out: pairs (i, j), i < j; consecutive scans are always left out.
        unsure: only pairs whose relative pose the estimate knows no better than registrations usually do; others would
            add little.
    """
    cell = settings.cell_voxels * voxel
    scans, overlap = _overlapping(outlines, solution, cell, settings)
    new = np.array([j - i > 1 and (i, j) not in left_out for i, j in scans.tolist()], bool)
    scans, overlap = scans[new], overlap[new]
    # twice as many as can be taken, since some prove uncertain
    likely = _best(scans, overlap, solution, 2 * settings.per_scan, settings.spread)
    scans, overlap = scans[likely], overlap[likely]
    T, covariances = solution.relatives(scans)
    useful = displacement(outlines, scans, covariances) >= (_usual(outlines, solution) if unsure else 0.0)
    scans, overlap = scans[useful], overlap[useful]
    overlap = overlap * certainties(outlines, scans, T[useful], covariances[useful], cell)
    kept = np.flatnonzero(overlap >= _least_overlap(scans, solution, settings).max(axis=1))
    best = kept[_best(scans[kept], overlap[kept], solution, settings.per_scan, settings.spread)]
    return [Candidate(int(scans[k, 0]), int(scans[k, 1]), "loop", float(overlap[k])) for k in best]


def _least_overlap(scans: np.ndarray, solution: Solution, settings: LoopSettings) -> np.ndarray:
    """Expected overlap from which pairs are candidates, for each of their scans, in the shape of `scans`: less where
    instruments measured both, so that a narrow strip shows their place."""
    measured = [pose for pose, prior in solution.graph.priors if prior.is_complete]
    return np.where(np.isin(scans, measured), _NARROW, 1.0) * settings.min_overlap


def _usual(outlines: Sequence[np.ndarray], solution: Solution) -> float:
    """Median over the registered edges of the displacement of points by an edge's covariance [m]."""
    registered = [edge for edge in solution.graph.edges if edge.is_registered]
    if not registered:
        return 0.0
    scans = np.array([(edge.i, edge.j) for edge in registered])
    covariances = np.stack([edge.registration.covariance for edge in registered])
    return float(np.median(displacement(outlines, scans, covariances)))


def certainties(
    outlines: Sequence[np.ndarray], pairs: np.ndarray, T: RigidTransform, covariances: np.ndarray, cell: float
) -> np.ndarray:
    """(m,) expected overlaps under the estimate's uncertainty, as shares of those at the estimate, 0..1.

    An overlap is the number of points in cells of the other scan; the expected one is the mean over random draws.

    Args:
        outlines: of N scans (`slam.map.cell.outline`).
        pairs: (m, 2) int, scans i and j.
        T: m estimates of T_i_j, and `covariances`: (m, 6, 6) of them, from the joint marginals of both poses.
        cell: edge of the cells in which scans are compared [m].
    """
    if not len(pairs):
        return np.zeros(0)
    tangents = np.einsum("nab,kb->nka", np.linalg.cholesky(covariances), _DRAWS).reshape(-1, 6)
    matrices = T.as_matrix()
    draws = matrices[:, None] @ RigidTransform.from_exp_coords(tangents).as_matrix().reshape(len(pairs), -1, 4, 4)
    occupied: dict[int, np.ndarray] = {}
    result = np.zeros(len(pairs))
    for k, (i, j) in enumerate(pairs.tolist()):
        if i not in occupied:
            occupied[i] = np.unique(cell_keys(outlines[i], cell, np.zeros(3))[0])
        at_estimate, *drawn = (
            _common(occupied[i], outlines[j] @ moved[:3, :3].T + moved[:3, 3], cell)
            for moved in (matrices[k], *draws[k])
        )
        if at_estimate:
            result[k] = min(1.0, sum(drawn) / len(drawn) / at_estimate)
    return result


def _common(occupied: np.ndarray, points: np.ndarray, cell: float) -> int:
    """Number of points in the cells with these sorted keys."""
    keys, _ = cell_keys(points, cell, np.zeros(3))
    place = np.minimum(np.searchsorted(occupied, keys), len(occupied) - 1)
    return int(np.count_nonzero(occupied[place] == keys))


def displacement(outlines: Sequence[np.ndarray], pairs: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """(m,) root mean square displacement of scan j's points relative to scan i [m], by (m, 6, 6) covariances of T_i_j
    for (m, 2) pairs."""
    of_points = (pose_variance(outlines[j], covariance) for j, covariance in zip(pairs[:, 1], covariances, strict=True))
    return np.sqrt([3 * variances.mean() for variances in of_points])


def _overlapping(
    outlines: Sequence[np.ndarray], solution: Solution, cell: float, settings: LoopSettings
) -> tuple[np.ndarray, np.ndarray]:
    """(m, 2) pairs i < j of scans of one component that overlap enough at the estimate, and (m,) their overlap."""
    scans, overlap = [np.empty((0, 2), np.intp)], [np.empty(0)]
    for members in solution.graph.components:
        if settings.per_scan == 0 or len(members) < 3:
            continue
        poses = np.array(members)
        least = _least_overlap(poses, solution, settings)
        T = solution.trajectory.T_world_sensor[poses]
        pairs, share = overlapping([outlines[k] for k in members], T, cell, float(least.min()))
        enough = share >= least[pairs].max(axis=1)
        scans.append(poses[pairs[enough]])
        overlap.append(share[enough])
    return np.concatenate(scans), np.concatenate(overlap)


def find_lookalikes(
    signatures: Sequence[np.ndarray | None],
    parts: Sequence[Sequence[int]],
    settings: LoopSettings,
    left_out: Container[tuple[int, int]] = frozenset(),
) -> list[Candidate]:
    """Candidates for loops between components, which have no common estimate, by similar signatures.

    Args:
        signatures: of N scans; None for a scan without one.
        parts: scans of each component of the graph.
    """
    part = {k: number for number, members in enumerate(parts) for k in members}
    usable = {k: signature for k, signature in enumerate(signatures) if signature is not None}
    scans = sorted(usable, key=lambda k: (part[k], k))
    if settings.per_scan == 0 or len({part[k] for k in scans}) < 2:
        return []
    parts_of, similar = np.array([part[k] for k in scans]), dict[tuple[int, ...], float]()
    index = PlaceIndex(np.stack([usable[k] for k in scans]), parts_of)
    for number in np.unique(parts_of):
        here, elsewhere = np.flatnonzero(parts_of == number), np.flatnonzero(parts_of != number)
        for one, distances in zip(here.tolist(), index.distances(here, elsewhere), strict=True):
            for near in np.argsort(distances, kind="stable")[: _LOOKALIKES * settings.per_scan].tolist():
                similar[tuple(sorted((scans[one], scans[elsewhere[near]])))] = float(distances[near])
    ranked = sorted((distance, *pair) for pair, distance in similar.items())
    new = [Candidate(i, j, "loop", alike=distance) for distance, i, j in ranked if (i, j) not in left_out]
    return [new[k] for k in within_limits([pair.scans for pair in new], settings.per_scan, settings.spread)]


def within_limits(ranked: Sequence[tuple[int, int]], per_scan: int, spread: int) -> list[int]:
    """Indices of the pairs to take, in their order, so that a scan has at most `per_scan` partners, all of them more
    than `spread` scans apart."""
    partners: dict[int, list[int]] = defaultdict(list)
    kept: list[int] = []
    for k, (i, j) in enumerate(ranked):
        full = max(len(partners[i]), len(partners[j])) >= per_scan
        if full:
            continue
        gaps = [abs(j - partner) for partner in partners[i]] + [abs(i - partner) for partner in partners[j]]
        if all(gap > spread for gap in gaps):
            partners[i].append(j)
            partners[j].append(i)
            kept.append(k)
    return kept


def _best(scans: np.ndarray, overlap: np.ndarray, solution: Solution, per_scan: int, spread: int) -> np.ndarray:
    """Indices of the pairs to take within the limits, best first: large overlap, many edges between the scans."""
    if not len(scans):
        return np.zeros(0, np.intp)
    apart = separations(len(solution.trajectory), solution.graph.edges, scans)
    # pairs that only instruments place in one frame are infinitely far apart along the edges
    # squared: with less overlap, scans see the place from different sides and err more
    worth = overlap**2 * np.log2(1 + np.minimum(apart, len(solution.trajectory)))
    order = np.lexsort((scans[:, 1], scans[:, 0], -worth))
    ranked = [(i, j) for i, j in scans[order].tolist()]
    return order[within_limits(ranked, per_scan, spread)]


def separations(count: int, edges: Sequence[Edge], pairs: np.ndarray) -> np.ndarray:
    """(m,) smallest number of edges between two poses; infinite if no path joins them.

    Args:
        pairs: (m, 2) int, different poses.
    """
    i, j = np.array([(edge.i, edge.j) for edge in edges if edge.kind != "prior"], np.intp).reshape(-1, 2).T
    joined = csr_array((np.ones(2 * len(i)), (np.append(i, j), np.append(j, i))), shape=(count, count))
    order, apart = np.argsort(pairs[:, 0], kind="stable"), np.empty(len(pairs))
    firsts, starts = np.unique(pairs[order, 0], return_index=True)
    for first, rows in zip(firsts.tolist(), np.split(order, starts[1:]), strict=True):
        apart[rows] = dijkstra(joined, indices=first, unweighted=True)[pairs[rows, 1]]
    return apart
