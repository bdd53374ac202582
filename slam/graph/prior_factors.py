"""Factors of what instruments measured of poses: attitude, heading, depth and position, each with its own noise."""

from collections.abc import Mapping, Sequence

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from spectral.measured import measured_rotation, twist
from spectral.scan import PosePrior

# Of a pose that ties a component to the world [rad, m]: far below any registration's.
GAUGE_SIGMA = 1e-6
# Of what is held of a pose beside what is measured of it: GTSAM takes a pivot 4096 times below its neighbor for none.
_HELD = 1e-4


def prior_factors(priors: Mapping[int, PosePrior], T_world_sensor: RigidTransform) -> list[gtsam.NonlinearFactor]:
    """Factors of what was measured, at most two a pose.

    Rotation: PosePrior's errors of roll, pitch and heading, those not measured with no weight; an unmeasured heading is
    taken from the estimate, so that only the tilt is left to compare. Translation: along East, North and Up.

    Args:
        priors: by pose.
        T_world_sensor: N poses, the estimate to start from, in the same world.
    """
    factors: list[gtsam.NonlinearFactor] = []
    for k, prior in sorted(priors.items()):
        precisions = 1 / prior.sigmas**2  # 0 where not measured
        if precisions[:3].any():
            R = _nearest(prior, T_world_sensor[k].rotation)
            factors.append(_rotation_factor(k, R, 1 / prior.sigmas[:3]))
        if precisions[3:].any():
            noise = gtsam.noiseModel.Diagonal.Precisions(precisions[3:])
            factors.append(gtsam.PoseTranslationPrior3D(k, prior.T_world_sensor.translation, noise))
    return factors


def unmeasured(members: Sequence[int], priors: Mapping[int, PosePrior]) -> np.ndarray:
    """(6,) bool: which of tilt, tilt, heading, East, North and Up no instrument tells of any of a component's poses.

    Positions of two poses tell the heading, of three and their depths the tilt too.
    """
    known = [priors[k] for k in members if k in priors]
    positions, depths = sum(p.knows_position for p in known), sum(p.knows_depth for p in known)
    tilted = any(p.knows_attitude for p in known) or min(positions, depths) >= 3
    headed = any(p.knows_heading for p in known) or positions >= 2
    return np.array([not tilted, not tilted, not headed, not positions, not positions, not depths])


def gauge_factors(pose: int, free: np.ndarray, T_world_sensor: RigidTransform) -> list[gtsam.NonlinearFactor]:
    """Factors that hold one pose where it is along what is `free`, (6,) bool as `unmeasured` gives it."""
    factors: list[gtsam.NonlinearFactor] = []
    if free[:3].any():
        factors.append(_rotation_factor(pose, T_world_sensor.rotation, free[:3] / _HELD))
    if free[3:].any():
        noise = gtsam.noiseModel.Diagonal.Precisions(free[3:] / _HELD**2)
        factors.append(gtsam.PoseTranslationPrior3D(pose, T_world_sensor.translation, noise))
    return factors


def _nearest(prior: PosePrior, R_estimate: Rotation) -> Rotation:
    """The measured rotation, its heading that of the estimate where it was not measured."""
    R = measured_rotation(prior)
    return R if prior.knows_heading else Rotation.from_euler("Z", twist(R_estimate * R.inv())) * R


def _rotation_factor(pose: int, R: Rotation, weights: np.ndarray) -> gtsam.NonlinearFactor:
    """Of R_true = Exp(w) R with w = Rz(h) v, h the twist of R: v has these (3,) inverse standard deviations [1/rad].

    GTSAM's error is e in R_true = R Exp(e), so that w = R e.
    """
    v_of_e = (Rotation.from_euler("Z", twist(R)).inv() * R).as_matrix()
    noise = gtsam.noiseModel.Gaussian.SqrtInformation(np.diag(weights) @ v_of_e)
    return gtsam.PoseRotationPrior3D(pose, gtsam.Rot3(R.as_matrix()), noise)
