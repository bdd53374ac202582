"""How sure the poses are: what a survey's own registrations say of their errors, and what they cannot say.

A registration's covariance has to hold for every sonar, and is too wide for most. How well a survey's registrations
agree where they close cycles tells how large its errors are: chi-squared over its degrees of freedom. Errors that
registrations share do not show there. All registrations of a scan share that scan's noise, so that edges are less sure
than their cycles say; and all of a survey fall a little short, as every scan has its own gaps, rims and lobes, which
move with the sensor: poses are the less sure the longer the way. What instruments measured of a pose is as sure as it
was measured. The constants were found with the spectral registration on simulated surveys; docs/measured has the
figures.
"""

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.linalg import block_diag
from scipy.sparse.linalg import splu
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import inverse_definite
from sonarmap.slam.graph.gtsam_poses import to_values
from sonarmap.slam.graph.known_pose import KnownPose
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution, factors_of
from sonarmap.slam.graph.tangent import adjoint

# The variance of an edge's error over what cycles say of it.
_OF_EDGES = 13.0
# How much all steps of a survey fall short together: the variance, as a share of a step's own.
_SCALE = 0.02
# Degrees of freedom of the errors' tails, and how often edges are weighed anew.
_TAILS, _REWEIGHTED = 4.0, 4
# Chi-squared over its degrees of freedom before a graph has loops enough to tell, and how many these are worth.
_EXPECTED, _WORTH = 0.15, 3.0


def weighed(graph: PoseGraph) -> PoseGraph:
    """The graph with its edges' covariances as large as their errors.

    One factor for all registrations, by how well cycles close; and more for an edge that the others contradict, as
    heavy tails would have it: two scans that saw a place from opposite sides err alike, by more than their noise says.
    Student's t with 4 degrees of freedom, by reweighted least squares (Lange, Little and Taylor, DOI
    10.2307/2290063). An edge that a person vouches for does not tell how large errors are where others contradict it,
    and weighs in full nevertheless.

    Args:
        graph: with its kept edges, about their optimum; what instruments say does not count, and is not scaled.
    """
    alone = graph.registered_alone
    weights, quotient = np.ones(len(alone.edges)), _EXPECTED
    for _ in range(_REWEIGHTED if weights.size else 0):
        solution = alone.optimize(covariances=False, scale_factors=1 / weights)
        alone = alone.at(solution.trajectory.T_world_sensor)
        squared = solution.residuals**2  # weighted
        quotient = (squared.sum() + _WORTH * _EXPECTED) / (solution.degrees_of_freedom + _WORTH)
        weights = np.minimum(1.0, (_TAILS + 6) / (_TAILS + squared / weights / quotient))
    scale_factors = np.ones(len(graph.edges))
    scale_factors[[edge.is_registered for edge in graph.edges]] = 1 / weights
    scale_factors[[edge.by_hand for edge in graph.edges]] = 1.0
    return graph.scaled(_OF_EDGES * quotient).with_scale_factors(scale_factors)


def pose_covariances(solution: Solution) -> np.ndarray:
    """(N, 6, 6) of each pose, rotation first [rad, m], body tangent, against its component's anchor, or the world.

    Args:
        solution: of a graph that has been `weighed`.
    """
    marginals, T = solution.covariances(), solution.trajectory.T_world_sensor
    graph, scale_variance = solution.graph, _scale_variance(solution)
    measured = np.zeros_like(marginals)
    for known in graph.gauge.all_known:
        measured[known.pose] += _in_body(known, T[known.pose])
    holding = {*graph.anchors, *graph.gauge.open_motions}
    result = np.empty_like(marginals)
    for component in graph.components:
        held = [k for k in component if k in holding]
        middle = T[held[0]].translation if held else T[list(component)].translation.mean(axis=0)
        for k in component:
            # what falls short on the way from where the component is held
            away = T[k].rotation.inv().apply(T[k].translation - middle)
            by_edges = _positive(inverse_definite(marginals[k]) - measured[k])
            result[k] = np.linalg.inv(_widened(by_edges, scale_variance * np.outer(away, away)) + measured[k])
    for k in graph.anchors:
        result[k] = marginals[k]
    return (result + result.swapaxes(1, 2)) / 2


def joint_covariance(graph: PoseGraph, poses: Sequence[int]) -> np.ndarray:
    """(6 k, 6 k) covariance of the errors of k of the N poses, six rows each, rotation first [rad, m]: of the left
    tangent, T_true = Exp(xi) T_world_sensor, so that a point p of a pose errs by w x p + v.

    Args:
        graph: at its optimum, with its edges as `weighed`.

    Raises:
        InputError: the edges do not determine every pose.
    """
    chosen = np.asarray(poses, np.intp)
    T = graph.trajectory.T_world_sensor
    row, column, entry = factors_of(graph).linearize(to_values(T)).sparseJacobian_()
    size = 6 * len(graph.trajectory)
    inside = column <= size  # behind it are the residuals
    places = row[inside].astype(np.intp) - 1, column[inside].astype(np.intp) - 1
    jacobian = sparse.csc_array((entry[inside], places), shape=(int(row.max()), size))
    rows = (6 * chosen[:, None] + np.arange(6)).ravel()
    asked = np.zeros((size, len(rows)))
    asked[rows, np.arange(len(rows))] = 1.0
    try:
        in_bodies = splu(sparse.csc_array(jacobian.T @ jacobian)).solve(asked)[rows]
    except RuntimeError as error:
        raise graph.unsolvable(error) from error
    A = adjoint(T[chosen])
    blocks = in_bodies.reshape(len(A), 6, len(A), 6)
    turned = np.einsum("iab,ibjc->iajc", A, blocks, optimize=True)
    joint = np.einsum("iajc,jdc->iajd", turned, A, optimize=True).reshape(in_bodies.shape)
    return (joint + joint.T) / 2


def _in_body(known: KnownPose, T_world_pose: RigidTransform) -> np.ndarray:
    """(6, 6) the information about a pose's body tangent, where the estimate has it."""
    turn = block_diag(np.eye(3), (known.T_world_pose.rotation.inv() * T_world_pose.rotation).as_matrix())
    return turn.T @ known.information @ turn


def _positive(information: np.ndarray) -> np.ndarray:
    """Without what is negative by rounding, where instruments alone place a pose."""
    values, axes = np.linalg.eigh((information + information.T) / 2)
    return (axes * np.maximum(values, 0.0)) @ axes.T


def _widened(information: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(6, 6) the information when a (3, 3) covariance of the shift is added; of the same rank."""
    across = information[:, 3:]
    return information - across @ np.linalg.solve(np.eye(3) + shift @ information[3:, 3:], shift @ across.T)


def _scale_variance(solution: Solution) -> float:
    """The variance of how far all steps are too short together, as a share of their lengths: of the median step."""
    shares: list[float] = []
    for edge in solution.graph.edges:
        T = edge.registration.T_target_source
        way = float(np.linalg.norm(T.translation))
        if edge.kind == "sequential" and way > 0:
            along = T.rotation.inv().apply(T.translation / way)
            shares.append(float(along @ edge.registration.covariance[3:, 3:] @ along) / way**2)
    return _SCALE * float(np.median(shares)) if shares else 0.0
