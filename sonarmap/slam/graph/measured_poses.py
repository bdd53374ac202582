"""What instruments measured of poses: attitude, heading, depth and position, each with its own noise."""

from collections.abc import Mapping
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.known_pose import KnownPose, blocks
from sonarmap.spectral.measured import twist
from sonarmap.spectral.scan import PosePrior


@dataclass(frozen=True, slots=True)
class MeasuredPoses:
    """What was measured of n poses, as arrays.

    Attributes:
        poses: (n,) int, ascending.
        T_world_pose: n, as measured: rotations level where the attitude is not, with the estimate's heading where that
            is not; translations 0 where they are not.
        turn: (n, 3, 3) information about w of R_true = R Exp(w) [1/rad^2].
        shift: (n, 3) information about the translation along East, North and Up [1/m^2].
    """

    poses: np.ndarray
    T_world_pose: RigidTransform
    turn: np.ndarray
    shift: np.ndarray

    @classmethod
    def of(cls, priors: Mapping[int, PosePrior], T_world_sensor: RigidTransform) -> "MeasuredPoses":
        """Rotation: PosePrior's errors of roll, pitch and heading, those not measured with no weight; an unmeasured
        heading is taken from the estimate, so that only the tilt is left to compare.

        Args:
            priors: by pose, at least one.
            T_world_sensor: N poses, the estimate to start from, in the same world.
        """
        poses = np.array(sorted(priors), np.intp)
        known = [priors[k] for k in poses.tolist()]
        precisions = 1 / np.stack([prior.sigmas for prior in known]) ** 2  # 0 where not measured
        T = RigidTransform.concatenate([prior.T_world_sensor for prior in known])
        R = _chosen(precisions[:, 0] > 0, T.rotation, Rotation.from_euler("Z", twist(T.rotation)[:, None]))
        turned = Rotation.from_euler("Z", twist(T_world_sensor[poses].rotation * R.inv())[:, None]) * R
        R = _chosen(precisions[:, 2] > 0, R, turned)
        return cls(
            poses,
            RigidTransform.from_components(T.translation, R),
            turn_information(R, precisions[:, :3]),
            precisions[:, 3:],
        )

    def known(self) -> list[KnownPose]:
        """Pose by pose."""
        R: np.ndarray = self.T_world_pose.rotation.as_matrix()
        information = np.zeros((len(self.poses), 6, 6))
        information[:, :3, :3] = self.turn
        information[:, 3:, 3:] = R.swapaxes(1, 2) @ (self.shift[:, :, None] * R)
        return [KnownPose(k, self.T_world_pose[n], information[n]) for n, k in enumerate(self.poses.tolist())]

    def factors(self) -> list[gtsam.NonlinearFactor]:
        """For GTSAM: of the rotation and of the translation of each."""
        R, t = self.T_world_pose.rotation.as_matrix(), self.T_world_pose.translation
        values, axes = np.linalg.eigh(self.turn)
        turn = np.sqrt(np.maximum(values, 0.0))[:, :, None] * axes.swapaxes(1, 2)
        shift = np.sqrt(self.shift)[:, :, None] * np.eye(3)
        factors: list[gtsam.NonlinearFactor] = []
        for n, k in enumerate(self.poses.tolist()):
            if self.turn[n].any():
                noise = gtsam.noiseModel.Gaussian.SqrtInformation(turn[n], False)
                factors.append(gtsam.PoseRotationPrior3D(k, gtsam.Rot3(R[n]), noise))
            if self.shift[n].any():
                noise = gtsam.noiseModel.Gaussian.SqrtInformation(shift[n], False)
                factors.append(gtsam.PoseTranslationPrior3D(k, t[n], noise))
        return factors


def known_at(priors: Mapping[int, PosePrior], T_world_sensor: RigidTransform) -> list[KnownPose]:
    """What instruments tell of poses, as if they had measured an estimate: nothing at all of what they do not measure.

    Args:
        priors: by pose.
        T_world_sensor: N poses, the estimate.
    """
    if not priors:
        return []
    poses = sorted(priors)
    T, precisions = T_world_sensor[poses], 1 / np.stack([priors[k].sigmas for k in poses]) ** 2
    R: np.ndarray = T.rotation.as_matrix()
    turns = turn_information(T.rotation, precisions[:, :3])
    shifts = R.swapaxes(1, 2) @ (precisions[:, 3:, None] * R)
    return [KnownPose(k, T[n], blocks(turns[n], shifts[n])) for n, k in enumerate(poses)]


def _chosen(which: np.ndarray, R: Rotation, other: Rotation) -> Rotation:
    """(n,) rotations: R where `which` says so, else the other."""
    return Rotation.from_quat(np.where(which[:, None], R.as_quat(), other.as_quat()))


def turn_information(R: Rotation, precisions: np.ndarray) -> np.ndarray:
    """(n, 3, 3) about e, of R_true = R Exp(e) = Exp(w) R with w = Rz(h) v, h the twist of R and v of these precisions
    (n, 3)."""
    M: np.ndarray = (Rotation.from_euler("Z", twist(R)[:, None]).inv() * R).as_matrix()
    return M.swapaxes(1, 2) @ (precisions[:, :, None] * M)
