"""Which measurements an optimum contradicts: those that it rests on, and others."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution
from sonarmap.slam.graph.tangent import lengths
from sonarmap.spectral.chi_squared import chi_squared

GATE = 1 - 1e-6  # probability of a right loop not to be contradicted by an estimate
_LEAST_SHARE = 1e-3  # of an edge's covariance that the others leave to its residual at least, against rounding


def contradicted_edges(
    graph: PoseGraph, solution: Solution, asked: np.ndarray, bound: float, gate: float | None = None
) -> np.ndarray:
    """Which edges the others contradict at the optimum, by number.

    First those whose residual is beyond it; where there are none, those without which the whole cost would fall by
    more: a wrong edge draws the poses to itself until its own residual is small. Where all cost more than
    their covariances say, as beside a chain that is less sure than it says, more is granted.

    Args:
        graph: of E edges, with the optimized poses.
        solution: the optimum of some of them, those `asked` about, (E,) bool, among them.
        asked: which to look at.
        bound: of a squared residual.
        gate: of the fall in cost; None for what one right edge in a million exceeds, as thousands are asked about.
    """
    residuals = graph.residuals()
    far = np.flatnonzero(asked & (residuals**2 > bound))
    chosen = np.flatnonzero(asked)
    if len(far) or not len(chosen):
        return far
    costs = falls_without([graph.edges[k] for k in chosen], solution)
    gate = chi_squared(GATE, 6) if gate is None else gate
    understated = max(1.0, float(np.median(costs)) / chi_squared(0.5, 6))
    return chosen[costs > gate * understated]


def falls_without(edges: Sequence[Edge], solution: Solution) -> np.ndarray:
    """(m,) by how much chi-squared would fall without each edge of an optimum, to first order, one left out at a time.

    Without the edge it lies so far from the others that its residual r, of covariance R, costs r' (R - P)^-1 r in all
    (P: of the pair with the edge). Where nothing but the edge holds the pair, P is R: then nothing contradicts it.
    """
    T_i_j, covariances = solution.relatives(np.array([(edge.i, edge.j) for edge in edges]))
    measured = RigidTransform.concatenate([edge.registration.T_target_source for edge in edges])
    stated = np.stack([edge.registration.covariance for edge in edges])
    xi: np.ndarray = (T_i_j.inv() * measured).as_exp_coords()
    return lengths(xi, stated - (1 - _LEAST_SHARE) * covariances) ** 2


def plausible(solution: Solution, others: Sequence[Edge]) -> np.ndarray:
    """(m,) bool: which of other edges an estimate does not contradict, within its own uncertainty.

    Covariances that are stated too large would let nearly everything pass: they are scaled by the largest factor of
    their variances that the inliers' own agreement leaves possible, where that is below 1.
    """
    degrees = solution.degrees_of_freedom
    # chi-squared over the least that so many degrees of freedom give by chance
    too_large = min(1.0, solution.chi_squared_after / chi_squared(1 - GATE, degrees)) if degrees >= 1 else 1.0
    most = float(np.sqrt(too_large * chi_squared(GATE, 6)))
    ends = np.array([(edge.i, edge.j) for edge in others], np.intp).reshape(-1, 2)
    return ~(solution.distances(ends, [edge.registration for edge in others], most) > most)  # NaN: no path joins them
