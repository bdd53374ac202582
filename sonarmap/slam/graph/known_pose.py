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
        R, t = self.T_world_pose.rotation.as_matrix(), self.T_world_pose.translation
        turn, shift = self.information[:3, :3], R @ self.information[3:, 3:] @ R.T
        if self.information[:3, 3:].any():
            return [gtsam.PriorFactorPose3(self.pose, gtsam.Pose3(gtsam.Rot3(R), t), _noise(_root(self.information)))]
        return _prior_factors(self.pose, R, t, _root(turn), _root(shift))


def _root(information: np.ndarray) -> np.ndarray:
    """(..., k, k) roots S of semidefinite matrices S'S."""
    values, axes = np.linalg.eigh(information)
    return np.sqrt(np.maximum(values, 0.0))[..., None] * axes.swapaxes(-1, -2)


def _noise(root: np.ndarray) -> gtsam.noiseModel.Base:
    """Gaussian noise with the information root' root."""
    return gtsam.noiseModel.Gaussian.SqrtInformation(root, False)


def _prior_factors(
    pose: int, R: np.ndarray, t: np.ndarray, turn: np.ndarray, shift: np.ndarray
) -> list[gtsam.NonlinearFactor]:
    """Factors of a rotation and of a translation from the roots of their information; none where that is 0."""
    factors: list[gtsam.NonlinearFactor] = []
    if turn.any():
        factors.append(gtsam.PoseRotationPrior3D(pose, gtsam.Rot3(R), _noise(turn)))
    if shift.any():
        factors.append(gtsam.PoseTranslationPrior3D(pose, t, _noise(shift)))
    return factors


def blocks(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(6, 6) block-diagonal matrix of two (3, 3) blocks, for the rotation and for the translation."""
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = turn, shift
    return both


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

    def known(self, T_world_sensor: RigidTransform) -> list[KnownPose]:
        """One prior per measured pose; unmeasured headings are those of an estimate of all N poses."""
        rotation = self.headed(T_world_sensor[self.poses])
        T = RigidTransform.from_components(self.T_world_pose.translation, rotation)
        R: np.ndarray = rotation.as_matrix()
        information = np.zeros((len(self.poses), 6, 6))
        information[:, :3, :3] = turn_information(rotation, self.precisions[:, :3])
        information[:, 3:, 3:] = R.swapaxes(1, 2) @ (self.precisions[:, 3:, None] * R)
        return [KnownPose(k, T[n], information[n]) for n, k in enumerate(self.poses.tolist())]

    def factors(self, T_world_sensor: RigidTransform) -> list[gtsam.NonlinearFactor]:
        """GTSAM factors of each measured rotation and translation, headings as for `known`."""
        rotation = self.headed(T_world_sensor[self.poses])
        turns = _root(turn_information(rotation, self.precisions[:, :3]))
        shifts = np.sqrt(self.precisions[:, 3:, None]) * np.eye(3)
        rows = zip(self.poses.tolist(), rotation.as_matrix(), self.T_world_pose.translation, turns, shifts, strict=True)
        return [factor for row in rows for factor in _prior_factors(*row)]


def _chosen(which: np.ndarray, R: Rotation, other: Rotation) -> Rotation:
    """(n,) rotations: R where `which` is true, else `other`."""
    return Rotation.from_quat(np.where(which[:, None], R.as_quat(), other.as_quat()))


def turn_information(R: Rotation, precisions: np.ndarray) -> np.ndarray:
    """(n, 3, 3) information about e in R_true = R Exp(e) = Exp(Rz(h) v) R, for h the twist of R and v with (n, 3)
    precisions."""
    M: np.ndarray = (Rotation.from_euler("Z", twist(R)[:, None]).inv() * R).as_matrix()
    return M.swapaxes(1, 2) @ (precisions[:, :, None] * M)
