"""Outlier rejection: the inliers among the measurements of a pose graph, and their optimum.

Graduated non-convexity with truncated least squares (Yang, Antonante, Tzoumas and Carlone, RA-L 2020,
DOI 10.1109/LRA.2020.2965893), by GTSAM. It begins with a limited number of loops, as a few hundred wrong ones fill the
equations, and a step takes seconds. The loops that agree with the most others come first, then those that the estimate
does not contradict.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import gtsam
import numpy as np
from scipy import sparse
from scipy.cluster.hierarchy import DisjointSet
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.decide.consistency import agreeing_groups, chain_parts, distances_from_chain
from sonarmap.slam.graph.edge import Edge, spanning_tree
from sonarmap.slam.graph.gtsam_poses import to_values
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution, factors_of
from sonarmap.slam.graph.tangent import lengths
from sonarmap.slam.graph.trajectory import chain
from sonarmap.spectral.chi_squared import chi_squared

GATE = 1 - 1e-6  # probability that an estimate does not contradict a right loop
PROBABILITY = 0.999  # that a right measurement is within the bound
FIRST = 200  # loops to begin with; more only if they agree with each other
_ROUNDS = 4  # most repetitions
_MAX_WHOLE = 1000  # poses of a graph that is solved as a whole
_REGION_SIZE = 60  # poses around each end of a doubtful edge of a larger graph
_LARGE_GROUP = 0.1  # least size of a group of agreeing loops to begin with, as a share of the largest group
_MIN_SHARE = 1e-3  # least share of an edge's covariance that remains for its residual, against rounding
_MIN_WEIGHT = 0.5  # of an inlier


@dataclass(frozen=True, slots=True)
class RobustSolution:
    """The inliers and their optimum."""

    solution: Solution  # of the graph of the accepted edges alone, in their order
    accepted: np.ndarray  # (E,) bool, of the given edges
    residuals: np.ndarray  # (E,) float64, residual of every edge at the optimum [sigmas]
    reasons: tuple[str, ...]  # (E,) why each edge was accepted or rejected


def robust_optimize(graph: PoseGraph, trust_chain: bool = True) -> RobustSolution:
    """Reject the measurements that the others contradict, and optimize the others.

    The initial estimate is the chain of the edges, consecutive ones before loops; the graph's own poses are used only
    if they are held. Priors, and edges that alone join two components, are always accepted.

    Args:
        graph: of any number of components.
        trust_chain: whether edges between consecutive scans are always accepted, as any number of loops between places
            of similar shape may agree with each other.
    """
    edges, bound = graph.edges, chi_squared(PROBABILITY, 6)
    fixed = np.array(
        [not e.is_registered or e.by_hand or (trust_chain and e.kind == "sequential") for e in edges], bool
    )
    graph = graph.placed_at(chain(edges, graph.trajectory.stamps).T_world_sensor)
    active = _first(graph, fixed)
    tried = active.astype(int)
    accepted, solution = _graduated(graph, active, fixed, bound)
    for _ in range(_ROUNDS - 1):
        graph = graph.at(solution.trajectory.T_world_sensor)
        others = np.flatnonzero(~accepted & (tried < 2))
        others = others[plausible(solution, [edges[k] for k in others])]
        if not len(others):
            break
        active = accepted.copy()
        active[others] = True
        tried += active
        accepted, solution = _graduated(graph, active, fixed, bound)
    graph = graph.at(solution.trajectory.T_world_sensor)
    return RobustSolution(solution, accepted, graph.residuals(), _reasons(graph, accepted, tried, fixed, bound))


def _first(graph: PoseGraph, fixed: np.ndarray) -> np.ndarray:
    """(E,) bool: the edges to begin with: all but loops, a spanning tree, and the largest groups of agreeing loops.

    Wrong loops between places of similar shape also agree, but in smaller groups, which are tried after the large ones
    have placed the poses. In a large graph, loops that contradict the chain are left out, as their least squares take
    minutes; but the largest group stays, and shows how far the chain is off.
    """
    edges, count = graph.edges, len(graph.trajectory)
    tree = spanning_tree(count, edges)
    joining = {id(edge) for edge in tree}
    active = fixed | np.array([edge.kind != "loop" or id(edge) in joining for edge in edges], bool)
    loops = np.flatnonzero(~active)
    chains, bound = chain_parts(count, tree), float(np.sqrt(chi_squared(GATE, 6)))
    groups = agreeing_groups(chains, [edges[k] for k in loops], bound)
    sizes = np.bincount(groups, minlength=1)
    chosen = sizes[groups] >= max(2.0, _LARGE_GROUP * sizes.max())
    grouped, alone = loops[chosen], loops[sizes[groups] == 1]
    if count > _MAX_WHOLE and len(grouped):
        away = distances_from_chain(chains, [edges[k] for k in grouped])
        largest = groups[chosen] == np.argmax(sizes)
        usual = np.sqrt(chi_squared(0.5, 6))
        grouped = grouped[largest | (away <= bound * max(1.0, float(np.median(away[largest]) / usual)))]
    active[grouped] = True
    active[alone[: max(0, FIRST - len(grouped))]] = True
    return active


def _graduated(graph: PoseGraph, active: np.ndarray, fixed: np.ndarray, bound: float) -> tuple[np.ndarray, Solution]:
    """(E,) bool, the inliers among the active edges by graduated non-convexity, and their optimum.

    In a large graph, it runs only in regions where edges contradict each other at the least-squares optimum.
    """
    weights = active.astype(np.float64)
    if len(graph.trajectory) <= _MAX_WHOLE:
        weights[active] = _weights(graph.keep(active), fixed[active], bound)
    for _ in range(_ROUNDS if len(graph.trajectory) > _MAX_WHOLE else 0):
        accepted = weights > _MIN_WEIGHT
        solution = graph.keep(accepted).optimize()
        graph = graph.at(solution.trajectory.T_world_sensor)
        doubtful = contradicted_edges(graph, solution, accepted & ~fixed, bound)
        if not len(doubtful):
            break
        for region in regions_about(graph, accepted, doubtful.tolist(), _REGION_SIZE):
            weights[region.edges] = _weights(region.graph, fixed[region.edges], bound)
    accepted = _rejoined(graph, active, weights)
    return accepted, graph.keep(accepted).optimize()


def _weights(graph: PoseGraph, fixed: np.ndarray, bound: float) -> np.ndarray:
    """(E,) final weight of each edge, 0 or 1 up to rounding."""
    factors = factors_of(graph)
    count = len(graph.edges)
    inner = gtsam.LevenbergMarquardtParams()
    inner.setRelativeErrorTol(1e-4)
    settings = gtsam.GncLMParams(inner)
    settings.setKnownInliers([*np.flatnonzero(fixed).tolist(), *range(count, factors.size())])
    settings.setRelativeCostTol(0.0)  # the cost can stop falling before the weights are 0 or 1
    optimizer = gtsam.GncLMOptimizer(factors, to_values(graph.trajectory.T_world_sensor), settings)
    optimizer.setInlierCostThresholds(bound / 2)  # GTSAM's cost has a factor 1/2
    optimizer.optimize()
    return optimizer.getWeights()[:count]


def _rejoined(graph: PoseGraph, active: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(E,) bool: the inliers, and the best of the other active edges that join components again."""
    joined = DisjointSet(range(len(graph.trajectory)))
    for one, other in pairwise(graph.gauge.in_world):
        joined.merge(one, other)
    accepted = weights > _MIN_WEIGHT
    for k in np.flatnonzero(accepted):
        joined.merge(graph.edges[k].i, graph.edges[k].j)
    rejected = np.flatnonzero(active & ~accepted)
    for k in rejected[np.lexsort((rejected, -weights[rejected]))]:
        accepted[k] = joined.merge(graph.edges[k].i, graph.edges[k].j)
    return accepted


def _reasons(
    graph: PoseGraph, accepted: np.ndarray, tried: np.ndarray, fixed: np.ndarray, bound: float
) -> tuple[str, ...]:
    residuals = graph.residuals()
    reasons = []
    for k in range(len(graph.edges)):
        apart = f"{residuals[k]:.1f} sigmas, {np.sqrt(bound):.1f} allowed"
        if fixed[k]:
            reasons.append("accepted: trusted")
        elif accepted[k]:
            reasons.append(f"accepted: agrees with the others to {apart}")
        elif tried[k]:
            reasons.append(f"rejected: the edges that agree with each other contradict it by {apart}")
        else:
            reasons.append(f"rejected: the estimate without it contradicts it by {apart}")
    return tuple(reasons)


@dataclass(frozen=True, slots=True)
class Region:
    """A region of a graph, as a graph of its own."""

    graph: PoseGraph  # of the region's poses; those at its border are held
    edges: np.ndarray  # the index of each of its edges in the whole graph


def regions_about(graph: PoseGraph, active: np.ndarray, doubtful: Sequence[int], size: int) -> list[Region]:
    """The regions of `size` poses around each end of doubtful edges; those that touch are merged.

    The graph is close to its optimum; the active edges, (E,) bool, connect its poses.
    """
    ends = np.array([(edge.i, edge.j) for edge in graph.edges])
    count, joining = len(graph.trajectory), np.flatnonzero(active)
    rows, columns = np.concatenate([ends[joining], ends[joining, ::-1]]).T
    joined = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    inside = np.zeros(count, bool)
    for pose in np.unique(ends[list(doubtful)]).tolist():
        inside[_around(joined, pose, size)] = True
    poses = np.flatnonzero(inside)
    # pyrefly: ignore[bad-index]
    _, place = connected_components(joined[poses][:, poses], directed=False)
    groups = np.split(poses[np.argsort(place, kind="stable")], np.cumsum(np.bincount(place))[:-1])
    return [_region(graph, ends, joining, group) for group in groups]


def _around(joined: sparse.csr_array, pose: int, size: int) -> list[int]:
    """The `size` poses that are the fewest edges away from a pose."""
    reached, waiting = {pose}, deque([pose])
    while waiting and len(reached) < size:
        k = waiting.popleft()
        new = [other for other in joined.indices[joined.indptr[k] : joined.indptr[k + 1]] if other not in reached]
        reached.update(new)
        waiting.extend(new)
    return list(reached)


def _region(graph: PoseGraph, ends: np.ndarray, joining: np.ndarray, poses: np.ndarray) -> Region:
    inside = np.zeros(len(graph.trajectory), bool)
    inside[poses] = True
    touching = inside[ends[joining]]
    number = np.cumsum(inside) - 1
    chosen = joining[touching.all(axis=1)]
    leaving = ends[joining[touching.any(axis=1) & ~touching.all(axis=1)]]
    border = set(leaving[inside[leaving]].tolist())

    def own(k: int) -> int:
        return int(number[k])

    return Region(
        PoseGraph(
            graph.trajectory.take(poses.tolist()),
            tuple(replace(graph.edges[k], i=own(graph.edges[k].i), j=own(graph.edges[k].j)) for k in chosen.tolist()),
            fixed=tuple(sorted(own(k) for k in border.union(k for k in graph.fixed if inside[k]))),
            priors=tuple((own(k), prior) for k, prior in graph.priors if inside[k]),
            known=tuple(replace(known, pose=own(known.pose)) for known in graph.known if inside[known.pose]),
            control=tuple(replace(point, scan=own(point.scan)) for point in graph.control if inside[point.scan]),
        ),
        chosen,
    )


def contradicted_edges(
    graph: PoseGraph, solution: Solution, asked: np.ndarray, bound: float, gate: float | None = None
) -> np.ndarray:
    """Indices of the edges that the others contradict at the optimum.

    These have a squared residual beyond the bound. If there are none, they are those without which chi-squared would
    fall by more than the gate: a wrong edge pulls the poses until its own residual is small. The gate is larger if the
    median fall is, as with a chain whose sigmas are underestimated.

    Args:
        graph: of E edges, with the optimized poses.
        solution: the optimum of some of them, the `asked` ones included.
        asked: (E,) bool, which edges to test.
        bound: of a squared residual.
        gate: of the fall in chi-squared; None for the one that one right edge in a million exceeds.
    """
    residuals = graph.residuals()
    beyond = np.flatnonzero(asked & (residuals**2 > bound))
    chosen = np.flatnonzero(asked)
    if len(beyond) or not len(chosen):
        return beyond
    costs = falls_without([graph.edges[k] for k in chosen], solution)
    gate = chi_squared(GATE, 6) if gate is None else gate
    underestimated = max(1.0, float(np.median(costs)) / chi_squared(0.5, 6))
    return chosen[costs > gate * underestimated]


def falls_without(edges: Sequence[Edge], solution: Solution) -> np.ndarray:
    """(m,) fall of chi-squared without each edge of an optimum, to first order, one left out at a time.

    It is r' (R - P)^-1 r for an edge with residual r and covariance R, where P is the covariance of the pair in the
    optimum. If only this edge constrains the pair, P is R: then nothing contradicts it.
    """
    T_i_j, covariances = solution.relatives(np.array([(edge.i, edge.j) for edge in edges]))
    measured = RigidTransform.concatenate([edge.registration.T_target_source for edge in edges])
    stated = np.stack([edge.registration.covariance for edge in edges])
    xi: np.ndarray = (T_i_j.inv() * measured).as_exp_coords()
    return lengths(xi, stated - (1 - _MIN_SHARE) * covariances) ** 2


def plausible(solution: Solution, others: Sequence[Edge]) -> np.ndarray:
    """(m,) bool: which of other edges agree with an estimate within its own uncertainty.

    With covariances that are too large, nearly every edge would agree. They are scaled by the largest variance factor
    that the inliers' chi-squared allows, if it is below 1.
    """
    degrees = solution.degrees_of_freedom
    # chi-squared relative to the smallest value that occurs by chance
    too_large = min(1.0, solution.chi_squared_after / chi_squared(1 - GATE, degrees)) if degrees >= 1 else 1.0
    limit = float(np.sqrt(too_large * chi_squared(GATE, 6)))
    ends = np.array([(edge.i, edge.j) for edge in others], np.intp).reshape(-1, 2)
    return ~(solution.distances(ends, [edge.registration for edge in others], limit) > limit)  # NaN: no path joins them
