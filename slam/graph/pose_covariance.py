# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
"""How sure the poses are: what a survey's own registrations say of their errors, and what they cannot say.

A registration's covariance has to hold for every sonar, and is too wide for most. How well a survey's registrations
agree where they close cycles tells how large its errors are: chi-squared over its degrees of freedom. Errors that
registrations share do not show there. All registrations of a scan share that scan's noise; and all of a survey fall a
little short, or turn a little too far, as every scan has its own gaps, rims and lobes, which move with the sensor. So
edges are less sure than their cycles say; poses are the less sure the longer the way, and each has a part of its own
that no loop takes away. What instruments measured of a pose is as sure as it was measured.
The constants were found with the spectral registration on simulated surveys; docs/slam.md has the figures.
"""

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform

from slam.graph.edge import inverse_definite
from slam.graph.known_pose import KnownPose
from slam.graph.pose_graph import PoseGraph, Solution
from slam.graph.tangent import carried

# The variance of an edge's error over what cycles say of it, and a pose's share of its marginal, beside what follows.
_OF_EDGES, _OF_POSES = 2.5, 0.8
# A scan's own part, as a share of its edges' covariance.
_OWN = 0.6
# How much all steps of a survey fall short together, and turn too far: the variances, as shares of a step's own.
_LEAN = 0.12
_TURN_LEAN = 0.12
# Keeps a scan's own part invertible [rad, m]^2.
_LEAST = 1e-12
# Degrees of freedom of the errors' tails, and how often edges are weighed anew.
_TAILS, _REWEIGHTED = 4.0, 4
# Chi-squared over its degrees of freedom before a graph has loops enough to tell, and how many these are worth.
_EXPECTED, _WORTH = 0.15, 20.0


def edge_variances(graph: PoseGraph) -> np.ndarray:
    """(E,) what the covariances of a graph's edges are to be multiplied by.

    One factor for all, by how well cycles close; and more for an edge that the others contradict, as heavy tails would
    have it: two scans that saw a place from opposite sides lean more than both their noise says. Student's t with 4
    degrees of freedom, by reweighted least squares (Lange, Little and Taylor, DOI 10.2307/2290063).

    Args:
        graph: with its kept edges, about their optimum; what instruments say does not count, and is not scaled.

    Raises:
        InputError: the equations have no unique or no finite solution.
    """
    alone = graph.registered_alone
    weights, quotient = np.ones(len(alone.edges)), _EXPECTED
    for _ in range(_REWEIGHTED if weights.size else 0):
        solution = alone.scaled(1 / weights).optimize()
        alone = alone.at(solution.trajectory.T_world_sensor)
        squared = solution.residuals**2  # weighted
        quotient = (squared.sum() + _WORTH * _EXPECTED) / (solution.degrees_of_freedom + _WORTH)
        weights = np.minimum(1.0, (_TAILS + 6) / (_TAILS + squared / weights / quotient))
    factors = np.ones(len(graph.edges))
    factors[[edge.is_registered for edge in graph.edges]] = _OF_EDGES * quotient / weights
    return factors


def pose_covariances(solution: Solution) -> np.ndarray:
    """(N, 6, 6) of each pose, rotation first [rad, m], body tangent, against its component's anchor, or the world.

    Args:
        solution: of a graph whose edges have been multiplied by their `edge_variances`.
    """
    marginals, T = solution.covariances(), solution.trajectory.T_world_sensor
    measured = np.zeros_like(marginals)
    for known in solution.graph.all_known:
        measured[known.pose] += _in_body(known, T[known.pose])
    own, anchors = _own_parts(solution), solution.graph.anchors
    turn_lean, lean = _lean(solution)
    for component in solution.graph.components:
        members, held = list(component), sorted(set(anchors).intersection(component))
        for anchor in held:
            others = [k for k in members if k != anchor]
            own[others] += carried(T[others].inv() * T[anchor], own[anchor])
        # what falls short, or turns too far, on the way from where the component is held
        places = T[members].translation
        away = T[members].rotation.inv().apply(places - (T[held[0]].translation if held else places.mean(axis=0)))
        own[members, :3, :3] += turn_lean * (away**2).sum(axis=1)[:, None, None] * np.eye(3)
        own[members, 3:, 3:] += lean * away[:, :, None] * away[:, None, :]
    result = np.empty_like(marginals)
    for k, marginal in enumerate(marginals):
        if k in anchors:
            result[k] = marginal
            continue
        by_edges = _positive(inverse_definite(marginal) - measured[k]) / _OF_POSES
        result[k] = np.linalg.inv(_widened(by_edges, own[k]) + measured[k])
    return (result + result.swapaxes(1, 2)) / 2


def _in_body(known: KnownPose, T_world_pose: RigidTransform) -> np.ndarray:
    """(6, 6) the information about a pose's body tangent, where the estimate has it."""
    turn = block_diag(np.eye(3), (known.T_world_pose.rotation.inv() * T_world_pose.rotation).as_matrix())
    return turn.T @ known.information @ turn


def _positive(information: np.ndarray) -> np.ndarray:
    """Without what is negative by rounding, where instruments alone place a pose."""
    values, axes = np.linalg.eigh((information + information.T) / 2)
    return (axes * np.maximum(values, 0.0)) @ axes.T


def _widened(information: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(6, 6) the information when a covariance is added; of the same rank."""
    if not own.any():
        return information
    root = np.linalg.cholesky(own + _LEAST * np.eye(6))
    values, axes = np.linalg.eigh(root.T @ information @ root)
    back = np.linalg.solve(root.T, axes)
    values = np.maximum(values, 0.0)
    return (back * (values / (1 + values))) @ back.T


def _lean(solution: Solution) -> tuple[float, float]:
    """The variances of what all ways may be off by together, of the median step.

    Of the turn over a way [rad^2/m^2], and of how short ways are, as a share of them.
    """
    turns: list[float] = []
    shares: list[float] = []
    for edge in solution.graph.edges:
        T = edge.registration.T_target_source
        way = float(np.linalg.norm(T.translation))
        if edge.kind == "sequential" and way > 0:
            along = T.rotation.inv().apply(T.translation / way)
            covariance = edge.registration.covariance
            turns.append(float(np.trace(covariance[:3, :3])) / 3 / way**2)
            shares.append(float(along @ covariance[3:, 3:] @ along) / way**2)
    return (_TURN_LEAN * float(np.median(turns)), _LEAN * float(np.median(shares))) if shares else (0.0, 0.0)


def _own_parts(solution: Solution) -> np.ndarray:
    """(N, 6, 6) a share of the mean covariance of each pose's edges, turned into its axes; 0 where it has none."""
    count = len(solution.trajectory)
    total, edges = np.zeros((count, 6, 6)), np.zeros(count)
    for edge in solution.graph.edges:
        if edge.is_registered:
            turn = block_diag(*[edge.registration.T_target_source.rotation.as_matrix()] * 2)
            of_j = edge.registration.covariance
            for pose, covariance in ((edge.j, of_j), (edge.i, turn @ of_j @ turn.T)):
                total[pose] += covariance
                edges[pose] += 1
    mean = total / np.maximum(edges, 1)[:, None, None]
    return _OWN * (mean + mean.swapaxes(1, 2)) / 2
