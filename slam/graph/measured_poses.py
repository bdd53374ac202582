"""What instruments measured of poses: attitude, heading, depth and position, each with its own noise."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from slam.graph.known_pose import KnownPose, blocks, held_pose, turned_information
from spectral.measured import measured_rotation, twist
from spectral.scan import PosePrior


def known_poses(priors: Mapping[int, PosePrior], T_world_sensor: RigidTransform) -> list[KnownPose]:
    """What was measured, pose by pose.

    Rotation: PosePrior's errors of roll, pitch and heading, those not measured with no weight; an unmeasured heading is
    taken from the estimate, so that only the tilt is left to compare. Translation: along East, North and Up.

    Args:
        priors: by pose.
        T_world_sensor: N poses, the estimate to start from, in the same world.
    """
    known = []
    for k, prior in sorted(priors.items()):
        precisions = 1 / prior.sigmas**2  # 0 where not measured
        R = _nearest(prior, T_world_sensor[k].rotation)
        information = blocks(_rotation_information(R, precisions[:3]), turned_information(R, np.diag(precisions[3:])))
        T = RigidTransform.from_components(prior.T_world_sensor.translation, R)
        known.append(KnownPose(k, T, information))
    return known


# How far a vehicle's roll and pitch usually are from 0, standard deviation [rad].
_LEVEL = float(np.deg2rad(15.0))
# What instruments may measure of a pose, in the order of `unmeasured`.
MEASURED = ("tilt_x", "tilt_y", "heading", "east", "north", "up")


def unmeasured(members: Sequence[int], priors: Mapping[int, PosePrior]) -> np.ndarray:
    """(6,) bool: which of tilt, tilt, heading, East, North and Up no instrument tells of any of a component's poses.

    Positions of two poses tell the heading, of three and their depths the tilt too.
    """
    known = [priors[k] for k in members if k in priors]
    positions, depths = sum(p.knows_position for p in known), sum(p.knows_depth for p in known)
    tilted = any(p.knows_attitude for p in known) or min(positions, depths) >= 3
    headed = any(p.knows_heading for p in known) or positions >= 2
    return np.array([not tilted, not tilted, not headed, not positions, not positions, not depths])


def level(members: Sequence[int], priors: Mapping[int, PosePrior], T_world_sensor: RigidTransform) -> KnownPose | None:
    """A vehicle floats about level: what is known of a component whose tilt positions alone would tell.

    Over a few meters these may tell any tilt, and turn the map on its side. None where attitudes are measured, or where
    not even positions tell the tilt, which is held then.
    """
    known = [k for k in members if k in priors]
    if not known or any(priors[k].knows_attitude for k in known) or unmeasured(members, priors)[:2].any():
        return None
    upright = Rotation.from_euler("Z", twist(T_world_sensor[known[0]].rotation))
    information = _rotation_information(upright, np.array([_LEVEL**-2, _LEVEL**-2, 0.0]))
    T = RigidTransform.from_components(T_world_sensor[known[0]].translation, upright)
    return KnownPose(known[0], T, blocks(information, np.zeros((3, 3))))


def gauge(pose: int, free: np.ndarray, T_world_sensor: RigidTransform) -> KnownPose:
    """What holds one pose where it is along what is `free`, (6,) bool as `unmeasured` gives it."""
    R = T_world_sensor.rotation
    of_world = blocks(Rotation.from_euler("Z", twist(R)).as_matrix(), np.eye(3))[:, free]
    return held_pose(pose, T_world_sensor, blocks(R.as_matrix().T, R.as_matrix().T) @ of_world)


def _nearest(prior: PosePrior, R_estimate: Rotation) -> Rotation:
    """The measured rotation, its heading that of the estimate where it was not measured."""
    R = measured_rotation(prior)
    return R if prior.knows_heading else Rotation.from_euler("Z", twist(R_estimate * R.inv())) * R


def _rotation_information(R: Rotation, precisions: np.ndarray) -> np.ndarray:
    """(3, 3) about e, of R_true = R Exp(e) = Exp(w) R with w = Rz(h) v, h the twist of R and v of these precisions."""
    return turned_information(Rotation.from_euler("Z", twist(R)).inv() * R, np.diag(precisions))
