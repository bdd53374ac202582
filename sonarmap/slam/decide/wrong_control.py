"""Control points that all other measurements contradict, such as wrongly picked ones."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sonarmap.slam.decide.wrong_measurements import TAILS, reweighted, sigmas_if_wrong
from sonarmap.slam.graph.control import ControlPoint, jacobian
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution

_MAX_WRONG = 0.3  # share of the points; if more seem wrong, the other measurements are


@dataclass(frozen=True, slots=True)
class WrongControl:
    """A control point that was left out."""

    point: ControlPoint  # as given
    sigmas: float  # distance from the estimate by all others, in standard deviations of the point and the map together


def without_wrong_control(graph: PoseGraph) -> tuple[tuple[ControlPoint, ...], tuple[WrongControl, ...]]:
    """The control points of a graph without those that its edges, priors and other points contradict; and the latter.

    The graph's poses are close to their places in the world."""
    if not graph.control:
        return (), ()

    def weighed(graph: PoseGraph, weights: np.ndarray) -> PoseGraph:
        sigmas = zip(graph.control, weights.tolist(), strict=True)
        return replace(
            graph, control=tuple(replace(point, sigmas=point.sigmas / np.sqrt(weight)) for point, weight in sigmas)
        )

    def weights_at(at: PoseGraph) -> np.ndarray:
        squared = np.array([(_apart(at, point) / point.sigmas) ** 2 for point in graph.control]).sum(axis=1)
        return np.minimum(1.0, (TAILS + 3) / (TAILS + squared))

    # far points begin with a low weight: with full weight they would bend the chain permanently
    solution, weights = reweighted(graph, weights_at(graph), weighed, weights_at)
    wrong = _wrong_control(solution, graph.control, weights)
    if len(wrong) > _MAX_WRONG * len(graph.control):
        return graph.control, ()
    left_out = {id(each.point) for each in wrong}
    return tuple(point for point in graph.control if id(point) not in left_out), wrong


def _apart(graph: PoseGraph, point: ControlPoint) -> np.ndarray:
    """(3,) from the known place of a control point to its place by the poses [m]."""
    return graph.trajectory.T_world_sensor[point.scan].apply(point.point) - point.known


def _wrong_control(
    solution: Solution, control: Sequence[ControlPoint], weights: np.ndarray
) -> tuple[WrongControl, ...]:
    suspects = [point for point, weight in zip(control, weights.tolist(), strict=True) if weight < 1]
    covariances, wrong = solution.covariances() if suspects else np.empty(0), list[WrongControl]()
    for point in suspects:
        J = jacobian(solution.trajectory.T_world_sensor[point.scan], point.point)
        both = J @ covariances[point.scan] @ J.T + np.diag(point.sigmas**2)
        if (sigmas := sigmas_if_wrong(_apart(solution.graph, point), both)) is not None:
            wrong.append(WrongControl(point, sigmas))
    return tuple(wrong)
