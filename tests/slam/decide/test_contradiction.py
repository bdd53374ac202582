"""What an edge costs an optimum is by how much chi-squared falls without it."""

from itertools import accumulate
from operator import mul

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.decide.contradiction import chi_squared, contradicted_edges
from sonarmap.slam.graph.pose_graph import PoseGraph
from tests.samples.surveys import chained_graph, edge

COUNT = 30
COVARIANCE = np.diag([0.01, 0.015, 0.02, 0.05, 0.06, 0.04]) ** 2


def ring(seed: int) -> PoseGraph:
    """A chain with a loop every few poses, one of them off by several sigmas."""
    rng = np.random.default_rng(seed)
    step = RigidTransform.from_exp_coords([0.02, -0.03, 2 * np.pi / COUNT, 1.0, 0.1, -0.05])
    T = RigidTransform.concatenate(list(accumulate([step] * (COUNT - 1), mul, initial=RigidTransform.identity())))
    pairs = [(k, k + 1) for k in range(COUNT - 1)] + [(0, 29), (2, 27), (4, 25), (6, 9), (10, 14), (3, 26)]
    edges = []
    for i, j in pairs:
        off = rng.multivariate_normal(np.zeros(6), COVARIANCE)
        off += 7 * np.array([0.01, 0, 0, 0, 0.06, 0]) * ((i, j) == (6, 9))
        noise = RigidTransform.from_exp_coords(off)
        edges.append(edge(i, j, T[i].inv() * T[j] * noise, COVARIANCE, "sequential" if j == i + 1 else "loop"))
    return chained_graph(edges, COUNT)


@pytest.mark.parametrize("seed", range(4))
def test_by_how_much_chi_squared_falls_without_an_edge(seed: int) -> None:
    graph = ring(seed)
    solution = graph.optimize()
    graph = graph.at(solution.trajectory.T_world_sensor)
    loops = np.array([one.kind == "loop" for one in graph.edges])
    falls = {}
    for k in np.flatnonzero(loops).tolist():
        without = graph.keep(np.arange(len(loops)) != k).optimize().chi_squared_after
        falls[k] = solution.chi_squared_after - without
    bound = chi_squared(0.999, 6)
    assert (graph.residuals()[loops] ** 2 < bound).all()  # none is far off by itself
    for limit in (0.3 * max(falls.values()), 0.9 * max(falls.values())):
        understated = max(1.0, float(np.median(list(falls.values()))) / chi_squared(0.5, 6))
        limit = max(limit / understated, float((graph.residuals()[loops] ** 2).max()) + 1e-9)
        expected = [k for k, fall in falls.items() if fall > limit * understated]
        clear = all(abs(fall / limit / understated - 1) > 0.05 for fall in falls.values())
        if clear:
            assert contradicted_edges(graph, solution, loops, limit, limit).tolist() == expected


def test_a_far_one_comes_first() -> None:
    graph = ring(0)
    solution = graph.optimize()
    graph = graph.at(solution.trajectory.T_world_sensor)
    loops = np.array([one.kind == "loop" for one in graph.edges])
    residuals = graph.residuals() ** 2
    worst = int(np.argmax(np.where(loops, residuals, 0)))
    assert contradicted_edges(graph, solution, loops, residuals[worst] * 0.99).tolist() == [worst]
    assert contradicted_edges(graph, solution, np.zeros_like(loops), 0.1).tolist() == []
    # the only tie is contradicted by nothing
    graph = ring(1).keep(np.arange(COUNT + 5) < COUNT - 1)  # a chain
    solution = graph.optimize()
    graph = graph.at(solution.trajectory.T_world_sensor)
    assert contradicted_edges(graph, solution, np.ones(COUNT - 1, bool), 1.0, 1.0).tolist() == []
