"""Regions of a graph, as graphs of their own."""

import numpy as np

from sonarmap.slam.decide.region import regions_about
from sonarmap.slam.graph.pose_graph import PoseGraph
from tests.samples.lawnmower import lawnmower


def optimum() -> PoseGraph:
    return lawnmower(400, 2.0, 4)[1].optimize(covariances=False).graph


def test_a_region_has_the_edges_with_both_ends_inside_and_its_rim_is_held() -> None:
    graph = optimum()
    active = np.ones(len(graph.edges), bool)
    active[450::7] = False
    stamps = graph.trajectory.stamps.astype(int)
    for region in regions_about(graph, active, [5, 300, 500], 30):
        own = region.graph.trajectory.stamps.astype(int)  # which are the poses' numbers in the whole graph
        inside = np.isin(stamps, own)
        ends = np.array([(one.i, one.j) for one in graph.edges])
        both = active & inside[ends].all(axis=1)
        np.testing.assert_array_equal(region.edges, np.flatnonzero(both))
        np.testing.assert_array_equal(own[[(one.i, one.j) for one in region.graph.edges]], ends[both])
        leaving = ends[active & (inside[ends].sum(axis=1) == 1)]
        np.testing.assert_array_equal(own[list(region.graph.fixed)], np.unique(leaving[inside[leaving]]))


def test_regions_that_touch_are_one_and_all_doubtful_edges_are_inside() -> None:
    graph = optimum()
    active = np.ones(len(graph.edges), bool)
    apart = regions_about(graph, active, [5, 395], 20)
    assert len(apart) == 2
    assert {5, 395} <= {int(k) for region in apart for k in region.edges}
    (one,) = regions_about(graph, active, [5, 6], 20)
    assert {5, 6} <= set(one.edges.tolist())


def test_the_optimum_of_a_region_is_where_that_of_the_whole_is() -> None:
    graph = optimum()
    for region in regions_about(graph, np.ones(len(graph.edges), bool), [200, 700], 60):
        again = region.graph.optimize(covariances=False).trajectory.T_world_sensor
        before = region.graph.trajectory.T_world_sensor
        np.testing.assert_allclose(again.as_matrix(), before.as_matrix(), atol=1e-4)
