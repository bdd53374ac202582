"""How sure the poses are when the registrations of one scan err alike.

A registration's error comes from the noise of both scans, and every registration of a scan shares that scan's:
registrations agree with one another better than with the truth, and more loops do not average out what they share. The
marginals, which take them as independent, are too small, and chi-squared stays below its degrees of freedom, higher
where the errors are larger. So the marginals are scaled by chi-squared, and each pose has a part of its own that no
loop takes away. The two constants were found with the spectral registration on nine simulated surveys of six scenes;
docs/slam.md has the figures.
"""

import numpy as np
from scipy.linalg import block_diag

from slam.graph.pose_graph import Solution
from slam.graph.tangent import carried

# What the marginals are multiplied by, as a multiple of chi-squared over its degrees of freedom; and a scan's own part,
# as a share of the same multiple of its edges' covariance.
_MARGINAL, _OWN = 5.0, 0.6
# That quotient before a graph has loops enough to tell, and how many degrees of freedom the expectation is worth.
_EXPECTED, _WORTH = 0.45, 60.0


def variance_factor(solution: Solution) -> float:
    """What multiplies the marginals; where the degrees of freedom are few it is drawn toward what is expected."""
    quotient = (solution.chi_squared_after + _WORTH * _EXPECTED) / (solution.degrees_of_freedom + _WORTH)
    return _MARGINAL * quotient


def pose_covariances(solution: Solution) -> np.ndarray:
    """(N, 6, 6) of each pose, rotation first [rad, m], body tangent, against its component's anchor.

    Poses are relative to the anchor, so its own part is added to theirs; the anchor itself has none. Where
    instruments tie the poses to the world there is no anchor.
    """
    factor = variance_factor(solution)
    own = _OWN * factor * _typical(solution)
    T = solution.trajectory.T_world_sensor
    result = factor * solution.covariances() + own
    for members in solution.graph.components:
        for anchor in set(solution.graph.anchors).intersection(members):
            chosen = np.array(members)
            result[chosen] += carried(T[chosen].inv() * T[anchor], own[anchor])
            result[anchor] -= 2 * own[anchor]
    return result


def _typical(solution: Solution) -> np.ndarray:
    """(N, 6, 6) the mean covariance of each pose's edges, turned into its axes; 0 where it has none."""
    count = len(solution.trajectory)
    total, edges = np.zeros((count, 6, 6)), np.zeros(count)
    for edge in solution.graph.edges:
        if edge.kind != "prior":
            turn = block_diag(*[edge.registration.T_target_source.rotation.as_matrix()] * 2)
            of_j = edge.registration.covariance
            for pose, covariance in ((edge.j, of_j), (edge.i, turn @ of_j @ turn.T)):
                total[pose] += covariance
                edges[pose] += 1
    mean = total / np.maximum(edges, 1)[:, None, None]
    return (mean + mean.swapaxes(1, 2)) / 2
