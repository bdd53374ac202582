"""Wrong edges among right ones: which are rejected, what is left of their harm, and regions of the graph alone."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.decide.robust import regions_about, robust_optimize
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory, chain
from tests.samples.lawnmower import lawnmower
from tests.samples.surveys import (
    aliased,
    chained_graph,
    distance,
    edge,
    measured_edge,
    random_covariance,
    ring_poses,
    scattered,
)

COUNT = 40


def measured(rng: np.random.Generator, T: RigidTransform, i: int, j: int) -> Edge:
    return measured_edge(rng, T, i, j, random_covariance(rng, 0.005, 0.05))


def two_rounds(seed: int, count: int = COUNT) -> tuple[RigidTransform, PoseGraph]:
    """Twice around the same ring, with loops between the rounds, some told backward."""
    rng = np.random.default_rng(seed)
    T = ring_poses(count, turns=2.0)
    pairs = [(k, k + 1) for k in range(count - 1)]
    pairs += [(k, k + count // 2) if k % 3 else (k + count // 2, k) for k in range(count // 2)]
    return T, chained_graph([measured(rng, T, i, j) for i, j in pairs], count)


@pytest.mark.parametrize("kind", ["scattered", "aliased"])
def test_wrong_loops_are_rejected_and_do_not_move_the_optimum(kind: str) -> None:
    T, graph = two_rounds(1, 60)
    wrong = scattered(graph, T, 15, 1) if kind == "scattered" else aliased(graph, T, 10, 1)
    mixed = PoseGraph(graph.trajectory, (*wrong[:4], *graph.edges, *wrong[4:]))
    result = robust_optimize(mixed)
    is_right = np.array([one not in wrong for one in mixed.edges])
    assert not result.accepted[~is_right].any()
    assert result.accepted[is_right].mean() > 0.97
    best = graph.optimize().trajectory.T_world_sensor
    assert distance(result.solution.trajectory.T_world_sensor, T) < 1.2 * distance(best, T) + 0.01
    for accepted, reason, residual in zip(result.accepted, result.reasons, result.residuals, strict=True):
        assert reason.startswith("accepted" if accepted else "rejected")
        assert accepted or residual > 4


def test_wrong_chain_edge_is_rejected_unless_the_chain_is_trusted() -> None:
    T, graph = two_rounds(5)
    slip = RigidTransform.from_exp_coords([0.2, -0.1, 0.4, 2, -1, 1])
    edges = list(graph.edges)
    right = edges[25].registration
    edges[25] = edge(25, 26, right.T_target_source * slip, right.covariance)
    result = robust_optimize(PoseGraph(graph.trajectory, tuple(edges)), trust_chain=False)
    assert np.flatnonzero(~result.accepted).tolist() == [25]
    assert distance(result.solution.trajectory.T_world_sensor, T) < 0.5
    trusted = robust_optimize(PoseGraph(graph.trajectory, tuple(edges)))
    assert trusted.accepted[25]
    assert not trusted.accepted.all()


def test_result_does_not_depend_on_order_or_run() -> None:
    T, graph = two_rounds(7)
    edges = (*graph.edges, *scattered(graph, T, 10, 7))
    once, again = (robust_optimize(PoseGraph(graph.trajectory, edges)) for _ in range(2))
    np.testing.assert_array_equal(once.accepted, again.accepted)
    np.testing.assert_array_equal(
        once.solution.trajectory.T_world_sensor.as_matrix(), again.solution.trajectory.T_world_sensor.as_matrix()
    )
    order = np.random.default_rng(0).permutation(len(edges))
    shuffled = robust_optimize(PoseGraph(graph.trajectory, tuple(edges[k] for k in order)))
    np.testing.assert_array_equal(shuffled.accepted, once.accepted[order])
    assert distance(shuffled.solution.trajectory.T_world_sensor, once.solution.trajectory.T_world_sensor) < 1e-4
    assert distance(once.solution.trajectory.T_world_sensor, T) < 0.5


def test_a_tree_and_a_prior_cannot_be_rejected() -> None:
    rng = np.random.default_rng(8)
    T = ring_poses(5)
    edges = tuple(measured(rng, T, k, k + 1) for k in range(4))
    far = edge(4, 4, RigidTransform.from_translation([500.0, 0, 0]), np.eye(6), "prior")
    result = robust_optimize(PoseGraph(chain(edges, np.arange(5.0)), (*edges, far), fixed=(0,)))
    assert result.accepted.all()


@pytest.mark.slow
def test_chain_with_underestimated_sigmas_keeps_right_loops() -> None:
    T, graph = lawnmower(1500, 2.5, 1)
    drift = RigidTransform.from_exp_coords([0, 0, 4e-3, 0, 0, 0])
    edges = [
        edge(one.i, one.j, one.registration.T_target_source * drift, one.registration.covariance)
        if one.kind == "sequential"
        else one
        for one in graph.edges
    ]
    wrong = scattered(graph, T, 20, 2)
    result = robust_optimize(PoseGraph(graph.trajectory, (*wrong, *edges)))
    assert not result.accepted[: len(wrong)].any()
    assert result.accepted[len(wrong) :].mean() > 0.95


def test_region_has_the_edges_with_both_ends_inside_and_holds_its_border() -> None:
    """Regions that touch are one."""
    graph = lawnmower(400, 2.0, 4)[1]
    active = np.ones(len(graph.edges), bool)
    active[450::7] = False
    stamps = graph.trajectory.stamps.astype(int)
    regions = regions_about(graph, active, [5, 6, 395], 20)
    assert [{5, 6, 395} & set(region.edges.tolist()) for region in regions] == [{5, 6}, {395}]
    for region in regions:
        own = region.graph.trajectory.stamps.astype(int)  # which are the poses' numbers in the whole graph
        inside = np.isin(stamps, own)
        ends = np.array([(one.i, one.j) for one in graph.edges])
        both = active & inside[ends].all(axis=1)
        np.testing.assert_array_equal(region.edges, np.flatnonzero(both))
        np.testing.assert_array_equal(own[[(one.i, one.j) for one in region.graph.edges]], ends[both])
        leaving = ends[active & (inside[ends].sum(axis=1) == 1)]
        np.testing.assert_array_equal(own[list(region.graph.fixed)], np.unique(leaving[inside[leaving]]))


@pytest.mark.slow
def test_components_are_independent_and_held_poses_stay() -> None:
    T, graph = two_rounds(6)
    moved = [edge(one.i + COUNT, one.j + COUNT, one.registration.T_target_source, one.registration.covariance, one.kind)
             for one in graph.edges]  # fmt: skip
    bad = edge(COUNT + 3, COUNT + 15, RigidTransform.from_translation([3.0, 1, 0]), np.eye(6) * 1e-4, "loop")
    place = RigidTransform.from_exp_coords([0.3, -0.2, 1.0, 50, 20, -3])
    start = RigidTransform.concatenate([T, place * T])
    both = PoseGraph(Trajectory(np.arange(2.0 * COUNT), start), (*graph.edges, *moved, bad), fixed=(COUNT + 7,))
    result = robust_optimize(both)
    assert np.flatnonzero(~result.accepted).tolist() == [len(both.edges) - 1]
    found = result.solution.trajectory.T_world_sensor
    np.testing.assert_allclose(found[[0, COUNT + 7]].as_matrix(), start[[0, COUNT + 7]].as_matrix(), atol=1e-5)
    assert distance(found[COUNT:], found[:COUNT]) < 1e-3


def test_without_wrong_edges_the_result_is_the_plain_optimum() -> None:
    _, graph = two_rounds(4)
    result = robust_optimize(graph)
    plain = graph.optimize()
    assert result.accepted.all()
    np.testing.assert_allclose(
        result.solution.trajectory.T_world_sensor.as_matrix(), plain.trajectory.T_world_sensor.as_matrix(), atol=1e-5
    )
    np.testing.assert_allclose(result.residuals, plain.residuals, atol=1e-3)
