"""How the errors of some poses of a graph go together."""

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from sonarmap.slam.graph.gtsam_poses import to_values
from sonarmap.slam.graph.pose_graph import PoseGraph, factors_of
from sonarmap.slam.graph.tangent import adjoint


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
