"""GTSAM factors of a pose graph, and the residuals of its edges."""

from collections.abc import Sequence

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.gauge import Gauge
from sonarmap.slam.graph.gtsam_poses import to_pose3
from sonarmap.slam.graph.tangent import lengths

_LEAST_RATIO = 1e-22  # of variances of one edge: a larger spread than 1e11 of its sigmas is rounding


def edge_factors(edges: Sequence[Edge]) -> list[gtsam.NonlinearFactor]:
    """One GTSAM factor per edge, in their order; poses are keys 0..N-1."""
    if not edges:
        return []
    poses = [gtsam.Pose3(matrix) for matrix in _measured(edges).as_matrix()]
    roots = _information_roots(_covariances(edges))
    noises = [gtsam.noiseModel.Gaussian.SqrtInformation(root, False) for root in roots]
    return [
        gtsam.PriorFactorPose3(edge.i, pose, noise)
        if edge.kind == "prior"
        else gtsam.BetweenFactorPose3(edge.i, edge.j, pose, noise)
        for edge, pose, noise in zip(edges, poses, noises, strict=True)
    ]


def residuals_of(edges: Sequence[Edge], T: RigidTransform) -> np.ndarray:
    """(E,) float64, each edge's residual in sigmas (the Mahalanobis length of its six numbers)."""
    if not edges:
        return np.zeros(0)
    ends, measured = np.array([(edge.i, edge.j) for edge in edges]), _measured(edges)
    from_i = T[ends[:, 0]].inv().as_matrix()
    from_i[[edge.kind == "prior" for edge in edges]] = np.eye(4)
    xi: np.ndarray = (measured.inv() * RigidTransform.from_matrix(from_i) * T[ends[:, 1]]).as_exp_coords()
    return lengths(xi, _covariances(edges))


def _measured(edges: Sequence[Edge]) -> RigidTransform:
    return RigidTransform.concatenate([edge.registration.T_target_source for edge in edges])


def _covariances(edges: Sequence[Edge]) -> np.ndarray:
    return np.stack([edge.registration.covariance for edge in edges])


def _information_roots(covariances: np.ndarray) -> np.ndarray:
    """(E, 6, 6) upper triangular roots R of information R'R, with positive diagonals.

    They follow from the covariances' eigenvalues: inverting would round away how unconstrained a direction is.
    """
    values, axes = np.linalg.eigh(covariances)
    values = np.maximum(values, _LEAST_RATIO * values[:, -1:])  # rounding may leave less than 0
    # pyrefly: ignore[bad-assignment]
    roots: np.ndarray = np.linalg.qr(axes.swapaxes(1, 2) / np.sqrt(values)[:, :, None], mode="r")
    return roots * np.sign(np.diagonal(roots, axis1=1, axis2=2))[:, :, None]


def gauge_factors(gauge: Gauge, sigma: float) -> list[gtsam.NonlinearFactor]:
    """GTSAM factors of single poses: anchors held with `sigma` [rad, m], priors, control points and held motions."""
    noise = gtsam.noiseModel.Isotropic.Sigma(6, sigma)
    return [
        *(gtsam.PriorFactorPose3(pose, to_pose3(gauge.T_world[pose]), noise) for pose in gauge.anchors),
        *(point.factor() for point in gauge.control),
        *(factor for each in gauge.known_poses for factor in each.factors()),
    ]
