"""Which answers agree: cycles through the chain, groups, parts that are joined; by laws."""

import numpy as np

from sonarmap.slam.decide.chains import chain_parts
from sonarmap.slam.graph.tangent import propagated
from tests.samples.surveys import (
    chain_edges,
    chained_graph,
    edge,
    random_covariance,
    ring_poses,
)

COVARIANCE = random_covariance(np.random.default_rng(2), 0.004, 0.03)


def test_what_gathers_along_a_chain_is_the_graphs_own_marginal():
    """Of a chain, and of a tree of scans 0-1-2 and 0-3-4, from 2 to 4 by way of 0."""
    truth = ring_poses(9)
    tree = [edge(i, j, truth[i].inv() * truth[j], COVARIANCE, "loop") for i, j in ((0, 1), (1, 2), (0, 3), (3, 4))]
    for edges, pairs in ((chain_edges(truth, COVARIANCE), ((0, 8), (2, 5), (6, 3))), (tree, ((2, 4),))):
        chains, solution = chain_parts(len(edges) + 1, edges), chained_graph(edges, len(edges) + 1).optimize()
        for i, j in pairs:
            gathered = propagated(chains.T[j].inv(), chains.between(np.array([i]), np.array([j]))[0])
            np.testing.assert_allclose(gathered, solution.relative(i, j)[1], rtol=1e-3, atol=1e-9)
