# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Control points that all others contradict: a wrong number in a list, or a point picked at another place."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from sonarmap.slam.graph.control import ControlPoint, jacobian
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution

# Degrees of freedom of the errors' tails, and how often points are weighed anew.
_TAILS, _REWEIGHTED = 2.0, 8
# A point is wrong where one of so many right ones is as far off.
_RARE = 1e-5
# Where more than this share of the points seem wrong, it is not they that are.
_MOST = 0.3


@dataclass(frozen=True, slots=True)
class WrongControl:
    """A control point that was left out.

    Attributes:
        point: as it was given.
        sigmas: how far it is from what all others say, in its own standard deviations and the map's together.
    """

    point: ControlPoint
    sigmas: float


def without_wrong_control(graph: PoseGraph) -> tuple[tuple[ControlPoint, ...], tuple[WrongControl, ...]]:
    """The control points of a graph without those that its edges, priors and other points contradict; and which.

    Reweighted least squares with heavy tails (Student's t), as of fixes (`slam.decide.wrong_fixes`): a point far off
    pulls less and less, until the others say where its scan is. A point that nothing else bears on is never wrong.

    Args:
        graph: its poses about where they are in the world.
    """
    if not graph.control:
        return (), ()
    # a point far off counts little from the beginning: at full weight it would bend a chain for good
    weights, solution = _weights(graph), None
    for _ in range(_REWEIGHTED):
        weighed = tuple(
            replace(point, sigmas=point.sigmas / np.sqrt(weight))
            for point, weight in zip(graph.control, weights.tolist(), strict=True)
        )
        solution = replace(graph, control=weighed).optimize()
        graph = graph.at(solution.trajectory.T_world_sensor)
        before = weights
        weights = _weights(graph)
        if np.abs(weights - before).max() < 1e-2:
            break
    assert solution is not None
    wrong = _wrong(solution, graph.control, weights)
    if len(wrong) > _MOST * len(graph.control):
        return graph.control, ()
    left_out = {id(each.point) for each in wrong}
    return tuple(point for point in graph.control if id(point) not in left_out), wrong


def _weights(graph: PoseGraph) -> np.ndarray:
    """(n,) of the control points, by how far the poses are from them."""
    squared = np.array([((_apart(graph, point)) / point.sigmas) ** 2 for point in graph.control]).sum(axis=1)
    return np.minimum(1.0, (_TAILS + 3) / (_TAILS + squared))


def _apart(graph: PoseGraph, point: ControlPoint) -> np.ndarray:
    """(3,) from where it is known to be to where the poses have it [m]."""
    return graph.trajectory.T_world_sensor[point.scan].apply(point.point) - point.known


def _wrong(solution: Solution, control: Sequence[ControlPoint], weights: np.ndarray) -> tuple[WrongControl, ...]:
    """Those that are farther from the estimate than both are unsure."""
    if not (weights < 1).any():
        return ()
    covariances, wrong = solution.covariances(), list[WrongControl]()
    for point, weight in zip(control, weights.tolist(), strict=True):
        if weight == 1:
            continue
        J = jacobian(solution.trajectory.T_world_sensor[point.scan], point.point)
        apart = _apart(solution.graph, point)
        both = J @ covariances[point.scan] @ J.T + np.diag(point.sigmas**2)
        squared = float(apart @ np.linalg.solve(both, apart))
        if squared > chdtri(3, _RARE):
            wrong.append(WrongControl(point, float(np.sqrt(squared))))
    return tuple(wrong)
