"""Wrong loops added to a graph of 2500 poses: how many are found, and what the others do to the poses.

Error: the root mean square distance of the poses from the truth, the first poses laid on each other; sphere2500 comes
without its truth, and a sphere of the same shape is simulated. Of sphere2500 itself the distance is that to the optimum
without wrong loops. Run with `-m slow -s` for the table.
"""

import time
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from surveys import edge
from wrong_loops import aliased, scattered

from slam.pose_graph import PoseGraph
from slam.robust import robust_optimize
from slam.trajectory import chain
from tools.readers.g2o import read_g2o

SPHERE = Path(__file__).parents[2] / "shared" / "data" / "graphs" / "sphere2500.g2o"
LAYERS, AROUND = 50, 50
COVARIANCE = np.diag([0.02, 0.03, 0.01, 0.1, 0.05, 0.08]) ** 2  # [rad^2, m^2]


def simulated_sphere(seed: int) -> tuple[RigidTransform, PoseGraph]:
    """2500 poses on a sphere of 50 m in layers, with an edge to the next pose and one to the layer above."""
    rng, count = np.random.default_rng(seed), LAYERS * AROUND
    turn = 2 * np.pi * np.arange(count) / AROUND
    height = np.pi * (np.arange(count) + 0.5) / count - np.pi / 2
    t = 50 * np.stack([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)], axis=1)
    T = RigidTransform.from_components(t, Rotation.from_euler("ZY", np.stack([turn + np.pi / 2, -height], axis=1)))
    pairs = [(k, k + 1) for k in range(count - 1)] + [(k, k + AROUND) for k in range(count - AROUND)]
    i, j = np.array(pairs).T
    noise = RigidTransform.from_exp_coords(rng.multivariate_normal(np.zeros(6), COVARIANCE, len(pairs)))
    measured = T[i].inv() * T[j] * noise
    edges = tuple(
        edge(i, j, one, COVARIANCE, "sequential" if j == i + 1 else "loop")
        for (i, j), one in zip(pairs, measured, strict=True)
    )
    return T, PoseGraph(chain(edges, np.arange(float(count))), edges)


def distance(one: RigidTransform, other: RigidTransform) -> float:
    """Root mean square of the positions' distances [m], the first poses laid on each other."""
    apart = (one[0].inv() * one).translation - (other[0].inv() * other).translation
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("kind", ["scattered", "aliased"])
@pytest.mark.parametrize("name", ["simulated", "sphere2500"])
def test_wrong_loops_do_little_harm(name: str, kind: str, share: float) -> None:
    if name == "sphere2500" and not SPHERE.is_file():
        pytest.skip(f"the benchmark graph is not at {SPHERE}")
    truth, graph = simulated_sphere(4) if name == "simulated" else (None, read_g2o(SPHERE))
    plain = graph.optimize()
    best = plain.trajectory.T_world_sensor
    count = round(share * sum(one.kind == "loop" for one in graph.edges))
    wrong = (scattered if kind == "scattered" else aliased)(graph, best, count, 7)
    begun = time.perf_counter()
    result = robust_optimize(PoseGraph(graph.trajectory, (*graph.edges, *wrong)))
    seconds = time.perf_counter() - begun
    rejected, is_wrong = ~result.accepted, np.arange(len(result.accepted)) >= len(graph.edges)
    found = int((rejected & is_wrong).sum())
    precision, recall = found / max(int(rejected.sum()), 1), found / count
    reference = best if truth is None else truth
    without, error = (distance(T, reference) for T in (best, result.solution.trajectory.T_world_sensor))
    print(
        f"\n{name:10} {kind:9} {share:4.0%}: {count:4} wrong, precision {precision:.4f}, recall {recall:.4f}, "
        f"error {without:.3f} m without and {error:.3f} m with them, {seconds:.0f} s"
    )
    assert precision > 0.97  # of right loops one in a thousand lies outside the bound
    assert recall > 0.99
    assert error <= 1.2 * without + (0.1 if truth is None else 0.0)
