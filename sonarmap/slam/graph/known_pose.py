"""Priors of single poses, from instruments and other sources, as GTSAM factors."""

from collections.abc import Mapping
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import ROUNDED
from sonarmap.spectral.geometry import cross_matrices, twist
from sonarmap.spectral.scan import PosePrior

GAUGE_SIGMA = 1e-6  # [rad, m], of an anchor: far below any registration's


@dataclass(frozen=True, slots=True)
class KnownPose:
    """Prior of one pose: R = R_measured Exp(w) and t = t_measured + R_measured v, with the information about (w, v)."""

    pose: int  # its index
    T_world_pose: RigidTransform  # as measured
    information: np.ndarray  # (6, 6) of (w, v) [1/rad^2, 1/m^2], symmetric; 0 in unconstrained directions

    def __post_init__(self) -> None:
        name = f"the information about pose {self.pose}"
        if self.information.shape != (6, 6) or not np.isfinite(self.information).all():
            raise InputError(f"{name} has shape {self.information.shape} or is not finite; wanted (6, 6) numbers")
        largest = float(np.abs(self.information).max())
        if np.abs(self.information - self.information.T).max() > ROUNDED * largest:
            raise InputError(f"{name} is not symmetric")
        smallest = float(np.linalg.eigvalsh(self.information).min())
        if smallest < -ROUNDED * largest:
            raise InputError(f"{name} is indefinite (smallest eigenvalue {smallest:.3g}); wanted none below 0")

    @property
    def rank(self) -> int:
        """Number of constrained directions, 0..6."""
        return int(np.linalg.matrix_rank(self.information, hermitian=True, rtol=ROUNDED))

    def factors(self) -> list[gtsam.NonlinearFactor]:
        """GTSAM factors of the rotation and of the translation, or one of the whole pose where these are coupled."""
        measured = gtsam.Pose3(self.T_world_pose.as_matrix())
        if self.information[:3, 3:].any():
            return [gtsam.PriorFactorPose3(self.pose, measured, _noise(self.information))]
        R = measured.rotation().matrix()
        turn, shift = self.information[:3, :3], R @ self.information[3:, 3:] @ R.T
        factors: list[gtsam.NonlinearFactor] = []
        if turn.any():
            factors.append(gtsam.PoseRotationPrior3D(self.pose, measured.rotation(), _noise(turn)))
        if shift.any():
            factors.append(gtsam.PoseTranslationPrior3D(self.pose, measured.translation(), _noise(shift)))
        return factors


def _noise(information: np.ndarray) -> gtsam.noiseModel.Base:
    """Gaussian noise with semidefinite information."""
    values, axes = np.linalg.eigh(information)
    return gtsam.noiseModel.Gaussian.SqrtInformation(np.sqrt(np.maximum(values, 0.0))[:, None] * axes.T, False)


@dataclass(frozen=True, slots=True)
class MeasuredPoses:
    """Instruments' priors of n poses, as arrays."""

    poses: np.ndarray  # (n,) int, ascending
    T_world_pose: RigidTransform  # n, as measured; rotations level where the attitude is not measured
    precisions: np.ndarray  # (n, 6) inverse variances of `PosePrior`'s errors [1/rad^2, 1/m^2]; 0 where not measured

    @classmethod
    def of(cls, priors: Mapping[int, PosePrior]) -> "MeasuredPoses":
        """From at least one prior, by pose."""
        poses = sorted(priors)
        T = RigidTransform.concatenate([priors[k].T_world_sensor for k in poses])
        precisions = 1 / np.stack([priors[k].sigmas for k in poses]) ** 2
        level = Rotation.from_euler("Z", twist(T.rotation)[:, None])
        R = _chosen(precisions[:, 0] > 0, T.rotation, level)
        return cls(np.array(poses, np.intp), RigidTransform.from_components(T.translation, R), precisions)

    def residuals(self, T_world_pose: RigidTransform) -> np.ndarray:
        """(n, 6) errors of the measurements, as `PosePrior` defines them, if these n poses were true [rad, m]; those
        of unmeasured numbers are meaningless."""
        R = self.headed(T_world_pose)
        w = Rotation.from_euler("Z", twist(R)[:, None]).inv().apply((T_world_pose.rotation * R.inv()).as_rotvec())
        return np.hstack([w, T_world_pose.translation - self.T_world_pose.translation])

    def jacobian(self, T_world_pose: RigidTransform, about: np.ndarray) -> np.ndarray:
        """(n, 6, 6) derivative of `residuals` with respect to a turn of all n poses about `about` (3,) and a shift,
        along the world's axes. An unmeasured heading follows the turn."""
        R = self.headed(T_world_pose)
        phi = (T_world_pose.rotation * R.inv()).as_rotvec()
        cross, angle = cross_matrices(phi), np.maximum(np.linalg.norm(phi, axis=1), 1e-6)[:, None, None]
        # derivative of log(Exp(w) Exp(phi)) with respect to w: the inverse left Jacobian of SO(3)
        second = 1 / angle**2 - (1 + np.cos(angle)) / (2 * angle * np.sin(np.minimum(angle, np.pi - 1e-6)))
        turns = np.eye(3) - cross / 2 + second * cross @ cross
        turns[self.precisions[:, 2] == 0, :, 2] = 0.0
        J = np.zeros((len(phi), 6, 6))
        J[:, :3, :3] = Rotation.from_euler("Z", twist(R)[:, None]).inv().as_matrix() @ turns
        J[:, 3:, :3], J[:, 3:, 3:] = -cross_matrices(T_world_pose.translation - about), np.eye(3)
        return J

    def headed(self, T_world_pose: RigidTransform) -> Rotation:
        """The n measured rotations, with unmeasured headings taken from these n poses."""
        R = self.T_world_pose.rotation
        turned = Rotation.from_euler("Z", twist(T_world_pose.rotation * R.inv())[:, None]) * R
        return _chosen(self.precisions[:, 2] > 0, R, turned)


def _chosen(which: np.ndarray, R: Rotation, other: Rotation) -> Rotation:
    """(n,) rotations: R where `which` is true, else `other`."""
    return Rotation.from_quat(np.where(which[:, None], R.as_quat(), other.as_quat()))


def known_poses(priors: Mapping[int, PosePrior], T_world_sensor: RigidTransform) -> list[KnownPose]:
    """Instruments' priors, by pose; unmeasured headings are those of an estimate of all N poses."""
    if not priors:
        return []
    measured = MeasuredPoses.of(priors)
    rotation = measured.headed(T_world_sensor[measured.poses])
    T = RigidTransform.from_components(measured.T_world_pose.translation, rotation)
    R: np.ndarray = rotation.as_matrix()
    # the errors of roll, pitch and heading are about the axes of the heading
    headed: np.ndarray = (Rotation.from_euler("Z", twist(rotation)[:, None]).inv() * rotation).as_matrix()
    information = np.zeros((len(R), 6, 6))
    information[:, :3, :3] = headed.swapaxes(1, 2) @ (measured.precisions[:, :3, None] * headed)
    information[:, 3:, 3:] = R.swapaxes(1, 2) @ (measured.precisions[:, 3:, None] * R)
    return [KnownPose(k, T[n], information[n]) for n, k in enumerate(measured.poses.tolist())]
