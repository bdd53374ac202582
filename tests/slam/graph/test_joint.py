"""The joint covariance of all poses compared with GTSAM's marginals of one and two poses."""

import numpy as np

from sonarmap.slam.graph.pose_covariance import joint_covariance
from sonarmap.slam.graph.tangent import propagated
from tests.samples.surveys import chain_edges, chained_graph, edge, random_covariance, ring_poses

COUNT = 6


def test_blocks_are_the_marginals_as_left_tangents() -> None:
    rng = np.random.default_rng(3)
    T = ring_poses(COUNT)
    covariance = random_covariance(rng, 0.01, 0.1)
    edges = [*chain_edges(T, covariance), edge(0, COUNT - 1, T[0].inv() * T[COUNT - 1], covariance, "loop")]
    solution = chained_graph(edges, COUNT).optimize()
    whole = joint_covariance(solution.graph, range(COUNT))
    joint = whole.reshape(COUNT, 6, COUNT, 6)
    T = solution.trajectory.T_world_sensor
    single = propagated(T, solution.covariances())
    np.testing.assert_allclose([joint[k, :, k] for k in range(COUNT)], single, rtol=1e-4, atol=1e-8)
    i, j = 2, 4
    # the error of T_i_j is the difference of both left tangents, as a body tangent of j
    apart = joint[i, :, i] + joint[j, :, j] - joint[i, :, j] - joint[j, :, i]
    np.testing.assert_allclose(propagated(T[j].inv(), apart), solution.relative(i, j)[1], rtol=1e-4, atol=1e-8)
    some = joint_covariance(solution.graph, [4, 1])
    rows = [*range(24, 30), *range(6, 12)]
    np.testing.assert_allclose(some, whole[np.ix_(rows, rows)], rtol=1e-6, atol=1e-12)
