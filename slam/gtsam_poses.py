"""Poses to GTSAM and back, and where relative rotations alone say that poses are."""

from collections.abc import Iterable

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform

START_SIGMA = 1e-2  # [rad, m], of the priors that `chordal_start` is given: with far firmer ones its equations fail


def to_pose3(T: RigidTransform) -> gtsam.Pose3:
    """One rigid transform as GTSAM's."""
    return gtsam.Pose3(T.as_matrix())


def to_values(T: RigidTransform, keys: Iterable[int] | None = None) -> gtsam.Values:
    """N transforms under N keys; under 0..N-1 where none are given."""
    values = gtsam.Values()
    for key, matrix in zip(range(len(T)) if keys is None else keys, T.as_matrix(), strict=True):
        values.insert(key, gtsam.Pose3(matrix))
    return values


def to_transforms(values: gtsam.Values, count: int) -> RigidTransform:
    """The transforms under the keys 0..count-1."""
    return RigidTransform.from_matrix(np.stack([values.atPose3(key).matrix() for key in range(count)]))


def chordal_start(factors: gtsam.NonlinearFactorGraph) -> gtsam.Values:
    """Poses from measurements between them and priors, without an initial guess.

    The rotations are those of a linear relaxation (Carlone, Tron, Daniilidis and Dellaert, ICRA 2015,
    DOI 10.1109/ICRA.2015.7139836); the translations follow from them. Factors other than BetweenFactorPose3 and
    PriorFactorPose3 are not heard, and priors are held only about as firmly as START_SIGMA says.

    Raises:
        RuntimeError: the measurements do not tell every pose.
    """
    return gtsam.InitializePose3.initialize(factors)
