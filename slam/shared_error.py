"""How sure the poses are when the registrations of one scan err alike.

A registration's error comes from the noise of both scans, and every registration of a scan shares that scan's: they
agree with one another better than with the truth. The graph sees it in its chi-squared, which stays below its degrees
of freedom by the share of the variance that the pairs have in common. That share moves a scan as a whole, averages over
no number of loops, and is added to the marginal of its pose and of the pose that the others are told against.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform

from slam.pose_graph import Solution
from slam.tangent import carried

# The factor that is expected before a graph has loops enough to tell, and how many degrees of freedom that is worth.
_EXPECTED, _WORTH = 0.6, 60.0


def variance_factor(solution: Solution) -> float:
    """Chi-squared over its degrees of freedom, drawn toward what is expected where these are few."""
    return (solution.chi_squared_after + _WORTH * _EXPECTED) / (solution.degrees_of_freedom + _WORTH)


def pose_covariances(solution: Solution) -> np.ndarray:
    """(N, 6, 6) of each pose, rotation first [rad, m], body tangent, against its component's anchor.

    The marginal times the variance factor, and where that is below 1 the scan's own part of what the edges' covariances
    hold beyond it, half of each edge's for either of its scans.
    """
    factor = variance_factor(solution)
    marginal = factor * solution.covariances()
    own = 0.5 * max(0.0, 1.0 - factor) * _typical(solution)
    T = solution.trajectory.T_world_sensor
    result = marginal + own
    for members in solution.graph.components:
        anchor = next((pose for pose in solution.graph.anchors if pose in set(members)), None)
        if anchor is not None:
            chosen = np.array(members)
            result[chosen] += carried(T[chosen].inv() * T[anchor], own[anchor])
            result[anchor] = marginal[anchor]
    return result


def _typical(solution: Solution) -> np.ndarray:
    """(N, 6, 6) the harmonic mean of the covariances of each pose's edges, in its own tangent; 0 where it has none."""
    count = len(solution.trajectory)
    information, edges = np.zeros((count, 6, 6)), np.zeros(count)
    between = [edge for edge in solution.graph.edges if edge.kind != "prior"]
    if between:
        T = RigidTransform.concatenate([edge.registration.T_target_source for edge in between])
        of_j = np.stack([edge.registration.covariance for edge in between])
        for ends, covariance in (([e.j for e in between], of_j), ([e.i for e in between], carried(T, of_j))):
            np.add.at(information, ends, np.linalg.inv(covariance))
            np.add.at(edges, ends, 1)
    result = np.zeros((count, 6, 6))
    some = edges > 0
    result[some] = np.linalg.inv(information[some] / edges[some, None, None])
    return (result + result.swapaxes(1, 2)) / 2
