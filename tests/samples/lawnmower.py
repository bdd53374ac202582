"""The pose graph of a survey in lanes, of any size, without scans."""

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.pose_graph import PoseGraph
from tests.samples.surveys import chained_graph, edge, from_the_first

STEP, LANE = 4.0, 15.0  # between scans along a lane, and between lanes [m]
REACH = 20.0  # a loop joins poses that are no farther apart [m]
SIGMAS = np.repeat([np.radians(0.1), 0.05], 3)  # of a registration between equal poses [rad, m]


def lawnmower(count: int, loops_per_pose: float, seed: int = 0) -> tuple[RigidTransform, PoseGraph]:
    """The true poses, and a graph of measurements whose errors follow their sigmas, which grow with distance. The
    lanes cover about a square; it has `loops_per_pose` loops per pose, at most about 2.7."""
    rng = np.random.default_rng(seed)
    T = _poses(count, rng)
    near = KDTree(T.translation).query_pairs(REACH, output_type="ndarray")
    loops = rng.permutation(near[near[:, 1] - near[:, 0] > REACH / STEP])[: round(loops_per_pose * count)]
    pairs = np.concatenate([np.column_stack([np.arange(count - 1), np.arange(1, count)]), loops])
    true: RigidTransform = T[pairs[:, 0]].inv() * T[pairs[:, 1]]
    sigmas = SIGMAS * (1 + np.linalg.norm(true.translation, axis=1, keepdims=True) / REACH)
    measured = true * RigidTransform.from_exp_coords(sigmas * rng.normal(size=sigmas.shape))
    edges = tuple(
        edge(i, j, T_i_j, np.diag(sigma**2), "sequential" if j == i + 1 else "loop")
        for (i, j), T_i_j, sigma in zip(pairs.tolist(), measured, sigmas, strict=True)
    )
    return T, chained_graph(edges, count)


def _poses(count: int, rng: np.random.Generator) -> RigidTransform:
    """Poses along lanes in alternating directions; the first is the identity."""
    per_lane = round(np.sqrt(count * LANE / STEP))
    lane, along = np.divmod(np.arange(count), per_lane)
    back = lane % 2 == 1
    x = np.where(back, per_lane - 1 - along, along) * STEP
    t = np.column_stack([x, lane * LANE, np.zeros(count)]) + 0.2 * rng.normal(size=(count, 3))
    angles = 0.03 * rng.normal(size=(count, 3))
    angles[:, 0] += np.where(back, np.pi, 0.0)
    return from_the_first(RigidTransform.from_components(t, Rotation.from_euler("ZYX", angles)))
