"""Covariances of a survey's poses, scaled to the errors that its own registrations show.

A registration's covariance has to hold for every sonar, and is too wide for most. The scale of a survey's errors
follows from its cycles, as chi-squared over its degrees of freedom. Errors that registrations share do not show there:
all registrations of a scan share its noise, so edges err by more than cycles show; and all steps of a survey are a
little too short, as the gaps, rims and lobes of scans move with the sensor, so pose errors grow with the distance;
and steps that the usual motion holds have its error in common.
Instruments' measurements keep their stated errors. docs/measured has the simulated surveys behind the constants.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse.linalg import splu
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import inverse_definite
from sonarmap.slam.graph.gtsam_poses import to_values
from sonarmap.slam.graph.known_pose import KnownPose
from sonarmap.slam.graph.marginals import information_of
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution, factors_of
from sonarmap.slam.graph.tangent import adjoint

_EDGE_VARIANCE = 13.0  # variance of an edge's error, over that which cycles show
_SHARED = 0.02  # share of the variance of registered steps that is a scale error of all of them
_TAIL_FREEDOM = 4.0  # degrees of freedom of Student's t distribution of the errors
_REWEIGHTINGS = 4  # iterations of reweighted least squares
_PRIOR_QUOTIENT = 0.15  # chi-squared over its degrees of freedom that is expected of a graph without loops
_PRIOR_FREEDOM = 3.0  # degrees of freedom that this expectation counts as


def weighed(graph: PoseGraph) -> PoseGraph:
    """The graph with its edges' covariances scaled to their errors.

    One factor for all registrations follows from how well cycles close. An edge that the others contradict gets a
    further one, by Student's t with 4 degrees of freedom and reweighted least squares (Lange, Little and Taylor, DOI
    10.2307/2290063): scans from opposite sides of a place err by more than their noise. An edge that a person vouches
    for is down-weighted only to find the common factor, not in the result.

    Args:
        graph: its kept edges, near their optimum; instruments' measurements take no part and are not scaled.
    """
    alone = graph.registered_alone
    weights, quotient = np.ones(len(alone.edges)), _PRIOR_QUOTIENT
    for _ in range(_REWEIGHTINGS if weights.size else 0):
        solution = alone.with_scale_factors(1 / weights).optimize(covariances=False)
        alone = alone.at(solution.trajectory.T_world_sensor)
        squared = solution.residuals**2  # weighted
        quotient = (squared.sum() + _PRIOR_FREEDOM * _PRIOR_QUOTIENT) / (solution.degrees_of_freedom + _PRIOR_FREEDOM)
        weights = np.minimum(1.0, (_TAIL_FREEDOM + 6) / (_TAIL_FREEDOM + squared / weights / quotient))
    scale_factors = np.ones(len(graph.edges))
    scale_factors[[edge.is_registered for edge in graph.edges]] = 1 / weights
    scale_factors[[edge.by_hand for edge in graph.edges]] = 1.0
    return graph.scaled(_EDGE_VARIANCE * quotient).with_scale_factors(scale_factors)


def pose_covariances(solution: Solution) -> np.ndarray:
    """(N, 6, 6) covariance of each pose, rotation first [rad, m], body tangent, relative to its component's anchor or
    the world.

    Args:
        solution: of a graph that has been `weighed`.
    """
    marginals, T = solution.covariances(), solution.trajectory.T_world_sensor
    graph, (scale, motion) = solution.graph, _shared_variances(solution)
    measured = np.zeros_like(marginals)
    for known in graph.gauge.all_known:
        measured[known.pose] += _in_body(known, T[known.pose])
    holding = {*graph.anchors, *graph.gauge.open_motions}
    result = np.empty_like(marginals)
    for component in graph.components:
        held = [k for k in component if k in holding]
        middle = T[held[0]].translation if held else T[list(component)].translation.mean(axis=0)
        for k in component:
            # errors that steps share grow with the distance from where the component is held
            R = T[k].rotation.as_matrix()
            offset = R.T @ (T[k].translation - middle)
            shared = scale * np.outer(offset, offset) + (offset @ offset) * R.T @ np.diag(motion) @ R
            by_edges = _positive(inverse_definite(marginals[k]) - measured[k])
            result[k] = np.linalg.inv(_widened(by_edges, shared) + measured[k])
    for k in graph.anchors:
        result[k] = marginals[k]
    return (result + result.swapaxes(1, 2)) / 2


def joint_covariance(graph: PoseGraph, poses: Sequence[int]) -> np.ndarray:
    """(6 k, 6 k) joint covariance of k of the N poses, six rows each, rotation first [rad, m]: of the left tangent,
    T_true = Exp(xi) T_world_sensor, by which a world point p of a pose errs by w x p + v.

    Args:
        graph: at its optimum, with its edges scaled by `weighed`.

    Raises:
        InputError: the edges do not determine every pose.
    """
    chosen = np.asarray(poses, np.intp)
    T = graph.trajectory.T_world_sensor
    information = information_of(factors_of(graph).linearize(to_values(T)), len(T))
    rows = (6 * chosen[:, None] + np.arange(6)).ravel()
    units = np.zeros((6 * len(T), len(rows)))
    units[rows, np.arange(len(rows))] = 1.0
    try:
        in_bodies = splu(information).solve(units)[rows]
    except RuntimeError as error:
        raise graph.unsolvable(error) from error
    A = adjoint(T[chosen])
    blocks = in_bodies.reshape(len(A), 6, len(A), 6)
    turned = np.einsum("iab,ibjc->iajc", A, blocks, optimize=True)
    joint = np.einsum("iajc,jdc->iajd", turned, A, optimize=True).reshape(in_bodies.shape)
    return (joint + joint.T) / 2


def _in_body(known: KnownPose, T_world_pose: RigidTransform) -> np.ndarray:
    """(6, 6) information of a prior about the body tangent at T_world_pose."""
    turn = block_diag(np.eye(3), (known.T_world_pose.rotation.inv() * T_world_pose.rotation).as_matrix())
    return turn.T @ known.information @ turn


def _positive(information: np.ndarray) -> np.ndarray:
    """The information without negative eigenvalues, which are rounding where instruments alone place a pose."""
    values, axes = np.linalg.eigh((information + information.T) / 2)
    return (axes * np.maximum(values, 0.0)) @ axes.T


def _widened(information: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(6, 6) information after a (3, 3) covariance is added to the translation's; of the same rank."""
    across = information[:, 3:]
    return information - across @ np.linalg.solve(np.eye(3) + shift @ information[3:, 3:], shift @ across.T)


def _shared_variances(solution: Solution) -> tuple[float, np.ndarray]:
    """Variances of the relative errors that all steps share, from the median step: of their length, by registrations,
    and (3,) along the component's axes, by the usual motion that holds steps where the scans do not."""
    scales: list[float] = []
    motions: list[np.ndarray] = []
    for edge in solution.graph.edges:
        registration = edge.registration
        T, by_scans = registration.T_target_source, registration.covariance_by_scans
        length = float(np.linalg.norm(T.translation))
        if edge.kind == "sequential" and length > 0:
            along = T.rotation.inv().apply(T.translation / length)
            covariance = registration.covariance
            scales.append(_SHARED * float(along @ covariance[3:, 3:] @ along) / length**2)
            # with information S^-1 of the scans and M^-1 of the motion, the motion's part of C is C M^-1 C
            held = (
                np.zeros((6, 6))
                if by_scans is None
                else covariance - covariance @ np.linalg.solve(by_scans, covariance)
            )
            R = solution.trajectory.T_world_sensor[edge.j].rotation.as_matrix()
            motions.append(np.diag(R @ held[3:, 3:] @ R.T) / length**2)
    return (float(np.median(scales)), np.median(motions, axis=0)) if scales else (0.0, np.zeros(3))
