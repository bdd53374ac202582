"""How many edges lie between two scans."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.loops.separation import separations
from tests.samples.surveys import chain_edges, edge

T, COVARIANCE = RigidTransform.identity(), np.eye(6)
CHAIN = chain_edges(RigidTransform.identity(10), COVARIANCE)


def test_it_is_counted_along_the_order_or_by_way_of_the_nearest_loop() -> None:
    pairs = np.array([(0, 9), (2, 3), (7, 1), (0, 9)])
    np.testing.assert_array_equal(separations(10, CHAIN, pairs), [9, 1, 6, 9])
    loop = edge(1, 8, T, COVARIANCE, "loop")
    np.testing.assert_array_equal(separations(10, [*CHAIN, loop], pairs), [3, 1, 2, 3])


def test_it_is_the_shortest_way_by_at_most_one_loop() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        loops = [tuple(sorted(rng.choice(40, 2, replace=False).tolist())) for _ in range(6)]
        chain = chain_edges(RigidTransform.identity(40), COVARIANCE)
        edges = [*chain, *(edge(i, j, T, COVARIANCE, "loop") for i, j in loops if j - i > 1)]
        pairs = np.array([rng.choice(40, 2, replace=False) for _ in range(30)])
        wanted = [
            min([abs(i - j), *(1 + min(abs(i - a) + abs(j - b), abs(i - b) + abs(j - a)) for a, b in loops)])
            for i, j in pairs.tolist()
        ]
        np.testing.assert_array_equal(separations(40, edges, pairs), wanted)


def test_a_gap_is_crossed_by_a_loop_alone() -> None:
    chain = [one for one in CHAIN if one.i != 4]
    pairs = np.array([(3, 4), (3, 7), (0, 9)])
    np.testing.assert_array_equal(separations(10, chain, pairs), [1, np.inf, np.inf])
    bridge = edge(4, 6, T, COVARIANCE, "loop")
    np.testing.assert_array_equal(separations(10, [*chain, bridge], pairs), [1, 3, 8])
    np.testing.assert_array_equal(separations(11, CHAIN, np.array([(0, 10), (3, 4)])), [np.inf, 1])
