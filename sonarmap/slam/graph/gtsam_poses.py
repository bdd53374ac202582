"""Poses to GTSAM and back, and the chordal initial estimate."""

import warnings

import gtsam
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import MatrixRankWarning, spsolve
from scipy.spatial.transform import RigidTransform, Rotation

START_SIGMA = 1e-2  # [rad, m], of the priors that anchor `chordal_start`


def to_pose3(T: RigidTransform) -> gtsam.Pose3:
    return gtsam.Pose3(T.as_matrix())


def to_values(T: RigidTransform) -> gtsam.Values:
    """GTSAM's values of poses, under the keys 0..N-1.

    Args:
        T: N transforms.
    """
    values = gtsam.Values()
    for key, matrix in enumerate(T.as_matrix()):
        values.insert(key, gtsam.Pose3(matrix))
    return values


def to_transforms(values: gtsam.Values, count: int) -> RigidTransform:
    """Poses of GTSAM's values.

    Args:
        values: with a Pose3 under each of the keys 0..count-1.
        count: number of poses.
    """
    return RigidTransform.from_matrix(np.stack([values.atPose3(key).matrix() for key in range(count)]))


def chordal_start(factors: gtsam.NonlinearFactorGraph, count: int) -> RigidTransform:
    """Poses 0..count-1 from measurements between them and priors, without an initial guess.

    The rotations are those of a linear relaxation (Carlone, Tron, Daniilidis and Dellaert, ICRA 2015,
    DOI 10.1109/ICRA.2015.7139836); the translations are the least-squares solution for these rotations.
    Factors other than BetweenFactorPose3 and PriorFactorPose3 are ignored.

    Raises:
        RuntimeError: the measurements do not determine every pose, or their weights differ by too much to be added.
    """
    orientations = gtsam.InitializePose3.initializeOrientations(factors)
    R = np.stack([orientations.atRot3(key).matrix() for key in range(count)])
    measured = [factors.at(k) for k in range(factors.size())]
    between = [factor for factor in measured if isinstance(factor, gtsam.BetweenFactorPose3)]
    priors = [factor for factor in measured if isinstance(factor, gtsam.PriorFactorPose3)]
    i, j = np.array([factor.keys() for factor in between], int).reshape(-1, 2).T
    moved = np.array([factor.measured().translation() for factor in between]).reshape(-1, 3)
    held = [factor.keys()[0] for factor in priors]
    places = np.array([factor.prior().translation() for factor in priors]).reshape(-1, 3)
    weights = np.sqrt([_translation_information(factor) for factor in (*between, *priors)])
    row = np.arange(len(weights))
    first = len(between)
    differences = sparse.csr_array(
        (
            np.concatenate([weights, -weights[:first]]),
            (np.concatenate([row, row[:first]]), np.concatenate([j, held, i]).astype(int)),
        ),
        shape=(len(weights), count),
    )
    wanted = weights[:, None] * np.vstack([np.einsum("mab,mb->ma", R[i], moved), places])
    normal = sparse.csc_array(differences.T @ differences)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MatrixRankWarning)  # raised below
        t = np.asarray(spsolve(normal, differences.T @ wanted)).reshape(count, 3)
    if not np.isfinite(t).all():
        raise RuntimeError("the measurements do not fix every translation")
    return RigidTransform.from_components(t, Rotation.from_matrix(R))


def _translation_information(factor: gtsam.NoiseModelFactor) -> float:
    """Trace of the information about the translation [1/m^2]."""
    noise = factor.noiseModel()
    assert isinstance(noise, gtsam.noiseModel.Gaussian)
    return float(np.trace(noise.information()[3:, 3:]))
