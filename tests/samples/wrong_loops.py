"""Loops that are wrong, to be told from the right ones: drawn apart, or in groups that agree with each other."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import PoseGraph
from tests.samples.surveys import edge

FAR = 10.0  # least residual of a wrong loop [sigmas]
GROUP = 20  # loops of an aliased place: as many consecutive poses see it


def scattered(graph: PoseGraph, T: RigidTransform, count: int, seed: int) -> tuple[Edge, ...]:
    """Random pairs of poses, each measured as a right loop of the graph might be, with that loop's covariance.

    Args:
        graph: whose loops say what a loop looks like.
        T: its poses, right or nearly so; a pair that happens to be right within them is drawn again.
    """
    rng = np.random.default_rng(seed)
    loops, poses = [one for one in graph.edges if one.kind == "loop"], len(graph.trajectory)
    wrong: list[Edge] = []
    while len(wrong) < count:
        i, j = sorted(rng.choice(poses, 2, replace=False).tolist())
        model = loops[rng.integers(len(loops))].registration
        error = (model.T_target_source.inv() * T[i].inv() * T[j]).as_exp_coords()
        if j - i > 2 and error @ np.linalg.solve(model.covariance, error) > FAR**2:
            wrong.append(edge(i, j, model.T_target_source, model.covariance, "loop"))
    return tuple(wrong)


def aliased(graph: PoseGraph, T: RigidTransform, count: int, seed: int) -> tuple[Edge, ...]:
    """Runs of consecutive poses that all take another place for theirs, at one and the same wrong offset.

    Args:
        graph: whose loops say what a loop looks like.
        T: its poses, right or nearly so: the groups agree within them up to the noise of the covariances.
    """
    rng = np.random.default_rng(seed)
    loops, poses = [one for one in graph.edges if one.kind == "loop"], len(graph.trajectory)
    wrong: list[Edge] = []
    while len(wrong) < count:
        a, b = sorted(rng.choice(poses - GROUP, 2, replace=False).tolist())
        if b - a <= GROUP:
            continue
        model = loops[rng.integers(len(loops))].registration
        offset = T[a] * model.T_target_source * T[b].inv()
        for k in range(min(GROUP, count - len(wrong))):
            noise = RigidTransform.from_exp_coords(rng.multivariate_normal(np.zeros(6), model.covariance))
            measured = T[a + k].inv() * offset * T[b + k] * noise
            wrong.append(edge(a + k, b + k, measured, model.covariance, "loop"))
    return tuple(wrong)
