"""Wrong loops added to graphs of 2500 poses and of a survey's 200: how many are found, and what the others do.

Error: the root mean square distance of the poses from the truth, the first poses laid on each other. The survey's are
decided about, as the mapper does it. Run with `-m slow -s` for the table.
"""

import time
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.decide.decision import decide
from sonarmap.slam.decide.robust import robust_optimize
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.pair import RegisteredPair
from tests.samples.lawnmower import lawnmower
from tests.samples.surveys import (
    aliased,
    chained_graph,
    distance,
    measured_edge,
    measurements_of,
    scattered,
)

LAYERS, AROUND = 50, 50
COVARIANCE = np.diag([0.02, 0.03, 0.01, 0.1, 0.05, 0.08]) ** 2  # [rad^2, m^2]


def sphere() -> tuple[RigidTransform, PoseGraph]:
    """2500 poses on a sphere of 50 m in layers, with an edge to the next pose and one to the layer above."""
    rng, count = np.random.default_rng(4), LAYERS * AROUND
    turn = 2 * np.pi * np.arange(count) / AROUND
    height = np.pi * (np.arange(count) + 0.5) / count - np.pi / 2
    t = 50 * np.stack([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)], axis=1)
    T = RigidTransform.from_components(t, Rotation.from_euler("ZY", np.stack([turn + np.pi / 2, -height], axis=1)))
    pairs = [(k, k + 1) for k in range(count - 1)] + [(k, k + AROUND) for k in range(count - AROUND)]
    return T, chained_graph([measured_edge(rng, T, i, j, COVARIANCE) for i, j in pairs], count)


def robust(graph: PoseGraph, wrong: Sequence[Edge]) -> tuple[RigidTransform, np.ndarray]:
    """The poses, and which edges are kept, the wrong ones behind the graph's own."""
    result = robust_optimize(PoseGraph(graph.trajectory, (*graph.edges, *wrong)))
    return result.solution.trajectory.T_world_sensor, result.accepted


def decided(graph: PoseGraph, wrong: Sequence[Edge]) -> tuple[RigidTransform, np.ndarray]:
    """As the mapper has it, which registers no pair twice."""
    pairs = [
        RegisteredPair(e.i, e.j, "sequential" if e.kind == "sequential" else "loop", registration=e.registration)
        for e in (*graph.edges, *wrong)
    ]
    result = decide(pairs, measurements_of(len(graph.trajectory)), 1.0, LoopSettings())
    return result.solution.trajectory.T_world_sensor, np.array([pair.kept for pair in result.pairs])


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("kind", ["scattered", "aliased"])
@pytest.mark.parametrize("name", ["sphere", "survey"])
def test_wrong_loops_do_little_harm(name: str, kind: str) -> None:
    truth, graph = sphere() if name == "sphere" else lawnmower(200, 1.5, 4)
    solve = robust if name == "sphere" else decided
    best, _ = solve(graph, ())
    right = {(one.i, one.j) for one in graph.edges}
    count = sum(one.kind == "loop" for one in graph.edges) // 2
    drawn = (scattered if kind == "scattered" else aliased)(graph, best, count, 7)
    wrong = list({(one.i, one.j): one for one in drawn if (one.i, one.j) not in right}.values())
    begun = time.perf_counter()
    T, kept = solve(graph, wrong)
    seconds = time.perf_counter() - begun
    found = int((~kept[len(graph.edges) :]).sum())
    precision, recall = found / max(int((~kept).sum()), 1), found / len(wrong)
    without, error = (distance(each, truth) for each in (best, T))
    print(
        f"\n{name:10} {kind:9}: {len(wrong):4} wrong, precision {precision:.4f}, recall {recall:.4f}, "
        f"error {without:.3f} m without and {error:.3f} m with them, {seconds:.0f} s"
    )
    assert precision > 0.97  # of right loops one in a thousand lies outside the bound
    assert recall > 0.99
    assert error <= 1.2 * without
