"""Measurements that contradict an optimum: its own edges, and others."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution
from sonarmap.slam.graph.tangent import lengths
from sonarmap.spectral.chi_squared import chi_squared

GATE = 1 - 1e-6  # probability that an estimate does not contradict a right loop
_MIN_SHARE = 1e-3  # least share of an edge's covariance that remains for its residual, against rounding


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
