"""The rigid motion that lays an estimated trajectory over the true one."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError

ARM = 1.0  # what an orientation error weighs: 1 rad as much as so many meters [m]
LINE_RATIO = 1e-3  # spread of positions across their main line, below which they fix no rotation about it


def align_poses(source: RigidTransform, target: RigidTransform) -> RigidTransform:
    """The rigid T_target_source of least squares between N corresponding poses, N >= 1.

    With positions p_i, q_i and orientations P_i, Q_i of target and source it minimizes, over R and t,

        sum |p_i - (R q_i + t)|^2 + (ARM^2 / 2) sum ||P_i - R Q_i||_F^2:

    the positions' squared distances, and the orientations' squared chordal distances (about 2 angle^2; Hartley et
    al., DOI 10.1007/s11263-012-0601-0), so that 1 rad weighs as much as 1 m. Orientations fix what positions leave
    open: a straight line or a single pose will do. The solution is closed, as Umeyama's without scale (DOI
    10.1109/34.88573): the orientations add to the positions' correlation matrix.
    """
    p, q = target.translation, source.translation
    middle_p, middle_q = p.mean(axis=0), q.mean(axis=0)
    turns = np.einsum("nij,nkj->ik", target.rotation.as_matrix(), source.rotation.as_matrix())
    U, _, Vt = np.linalg.svd((p - middle_p).T @ (q - middle_q) + ARM**2 / 2 * turns)
    R = Rotation.from_matrix(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)
    return RigidTransform.from_components(middle_p - R.apply(middle_q), R)


def align_positions(source: np.ndarray, target: np.ndarray) -> RigidTransform:
    """The rigid T_target_source of least squares between corresponding positions (N, 3) [m], N >= 3.

    Umeyama's solution without scale (DOI 10.1109/34.88573).

    Raises:
        InputError: fewer than three positions, or positions on one line, about which any rotation fits.
    """
    spread = [np.linalg.svd(points - points.mean(axis=0), compute_uv=False) for points in (source, target)]
    if len(source) < 3 or any(values[1] <= LINE_RATIO * values[0] for values in spread):
        raise InputError(
            f"{len(source)} common positions on one line fix no alignment; wanted three or more that do not "
            "lie on a line, or the alignment 'first'"
        )
    middle_source, middle_target = source.mean(axis=0), target.mean(axis=0)
    rotation = Rotation.align_vectors(target - middle_target, source - middle_source)[0]
    return RigidTransform.from_components(middle_target - rotation.apply(middle_source), rotation)
