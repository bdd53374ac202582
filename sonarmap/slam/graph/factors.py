"""All that a pose graph knows as GTSAM's factors, and how far poses are from its edges."""

from collections.abc import Sequence

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.gauge import Gauge
from sonarmap.slam.graph.gtsam_poses import to_pose3
from sonarmap.slam.graph.tangent import lengths

# Translations of an edge are held by standard deviations no farther apart than this.
_SPREAD = 1000.0


def edge_factors(edges: Sequence[Edge], scale_factors: np.ndarray | None = None) -> list[gtsam.NonlinearFactor]:
    """What each edge says, for GTSAM; poses are keys 0..N-1.

    Args:
        scale_factors: (E,) by which their covariances are multiplied; 1 by default.
    """
    if not edges:
        return []
    poses = [gtsam.Pose3(matrix) for matrix in _measured(edges).as_matrix()]
    covariances = _solvable(edges)
    if scale_factors is not None:
        covariances *= scale_factors[:, None, None]
    noises = [gtsam.noiseModel.Gaussian.Covariance(covariance) for covariance in covariances]
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
    return lengths(xi, _solvable(edges))


def _measured(edges: Sequence[Edge]) -> RigidTransform:
    return RigidTransform.concatenate([edge.registration.T_target_source for edge in edges])


def _solvable(edges: Sequence[Edge]) -> np.ndarray:
    """(E, 6, 6) covariances that GTSAM can factor; along a bare wall the one direction is hundreds of meters, the
    others centimeters.

    It takes a pivot 4096 times below its neighbor for none: so what is that unconstrained is held a thousand times less
    than what is held best.
    """
    covariances = np.stack([edge.registration.covariance for edge in edges])
    information = np.linalg.inv(covariances)
    best = np.diagonal(information, axis1=1, axis2=2)[:, 3:].max(axis=1)
    weak = np.diagonal(covariances, axis1=1, axis2=2)[:, 3:].max(axis=1) * best > _SPREAD**2
    if weak.any():
        held = information[weak]
        held[:, range(3, 6), range(3, 6)] += best[weak, None] / _SPREAD**2
        held = np.linalg.inv(held)
        covariances[weak] = (held + held.swapaxes(1, 2)) / 2
    return covariances


def gauge_factors(gauge: Gauge, sigma: float) -> list[gtsam.NonlinearFactor]:
    """What is known of single poses: the anchors held where they are by `sigma` [rad, m], and what was measured."""
    held, measured = gtsam.noiseModel.Isotropic.Sigma(6, sigma), gauge.by_priors
    return [
        *(gtsam.PriorFactorPose3(pose, to_pose3(gauge.T_world[pose]), held) for pose in gauge.anchors),
        *(() if measured is None else measured.factors(gauge.T_world)),
        *(point.factor() for point in gauge.control),
        *(factor for each in gauge.beside_priors for factor in each.factors()),
    ]
