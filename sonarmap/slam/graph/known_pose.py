# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
"""What is known of single poses beside the edges, whoever measured it, as factors of a graph."""

from collections.abc import Mapping
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.measured import twist
from sonarmap.spectral.scan import PosePrior

# Of a pose that ties a component to the world [rad, m]: far below any registration's.
GAUGE_SIGMA = 1e-6
# Of what is held of a pose beside what is measured of it [rad, m]: GTSAM takes a pivot 4096 times below its neighbor
# for none.
_HELD = 1e-4
# Eigenvalues of an information matrix down to this share of the largest below 0 are rounded.
_ROUNDED = 1e-9


@dataclass(frozen=True, slots=True)
class KnownPose:
    """What is known of one pose: R = R_measured Exp(w) and t = t_measured + R_measured v, and how well w and v.

    Raises:
        InputError: an information that is not finite, symmetric and positive semidefinite.
    """

    pose: int  # its index
    T_world_pose: RigidTransform  # as measured
    information: np.ndarray  # (6, 6) of (w, v) [1/rad^2, 1/m^2], symmetric; 0 in directions that are not known

    def __post_init__(self) -> None:
        name = f"the information about pose {self.pose}"
        if self.information.shape != (6, 6) or not np.isfinite(self.information).all():
            raise InputError(f"{name} has shape {self.information.shape} or is not finite; wanted (6, 6) numbers")
        largest = float(np.abs(self.information).max())
        if np.abs(self.information - self.information.T).max() > _ROUNDED * largest:
            raise InputError(f"{name} is not symmetric")
        smallest = float(np.linalg.eigvalsh(self.information).min())
        if smallest < -_ROUNDED * largest:
            raise InputError(f"{name} is indefinite (smallest eigenvalue {smallest:.3g}); wanted none below 0")

    @property
    def rank(self) -> int:
        """How many numbers are known."""
        return int(np.linalg.matrix_rank(self.information, hermitian=True, rtol=_ROUNDED))

    def factors(self) -> list[gtsam.NonlinearFactor]:
        """For GTSAM: of the rotation and of the translation; where these are coupled one, of the pose's logarithm."""
        R, t = self.T_world_pose.rotation.as_matrix(), self.T_world_pose.translation
        turn, shift = self.information[:3, :3], R @ self.information[3:, 3:] @ R.T
        if self.information[:3, 3:].any():
            return [gtsam.PriorFactorPose3(self.pose, gtsam.Pose3(gtsam.Rot3(R), t), _noise(_root(self.information)))]
        return _prior_factors(self.pose, R, t, _root(turn), _root(shift))


def held_pose(pose: int, T_world_pose: RigidTransform, free: np.ndarray) -> KnownPose:
    """One pose held where it is along what is `free`, (6, k) orthonormal columns of (w, v) as `KnownPose` has them."""
    return KnownPose(pose, T_world_pose, free @ free.T / _HELD**2)


def _root(information: np.ndarray) -> np.ndarray:
    """(..., k, k) roots S of semidefinite matrices S'S."""
    values, axes = np.linalg.eigh(information)
    return np.sqrt(np.maximum(values, 0.0))[..., None] * axes.swapaxes(-1, -2)


def _noise(root: np.ndarray) -> gtsam.noiseModel.Base:
    """Gaussian noise by the root of an information."""
    return gtsam.noiseModel.Gaussian.SqrtInformation(root, False)


def _prior_factors(
    pose: int, R: np.ndarray, t: np.ndarray, turn: np.ndarray, shift: np.ndarray
) -> list[gtsam.NonlinearFactor]:
    """Of a rotation and of a translation, by the roots of their information; none of what is not known."""
    factors: list[gtsam.NonlinearFactor] = []
    if turn.any():
        factors.append(gtsam.PoseRotationPrior3D(pose, gtsam.Rot3(R), _noise(turn)))
    if shift.any():
        factors.append(gtsam.PoseTranslationPrior3D(pose, t, _noise(shift)))
    return factors


def blocks(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(6, 6) of a (3, 3) matrix for turns and one for shifts."""
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = turn, shift
    return both


@dataclass(frozen=True, slots=True)
class MeasuredPoses:
    """What was measured of n poses, as arrays."""

    poses: np.ndarray  # (n,) int, ascending
    # n, as measured: rotations level where the attitude is not, with the estimate's heading where that is not;
    # translations 0 where they are not
    T_world_pose: RigidTransform
    turn: np.ndarray  # (n, 3, 3) information about w of R_true = R Exp(w) [1/rad^2]
    shift: np.ndarray  # (n, 3) information about the translation along East, North and Up [1/m^2]

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
        tilted = _chosen(precisions[:, 0] > 0, T.rotation, Rotation.from_euler("Z", twist(T.rotation)[:, None]))
        turned = Rotation.from_euler("Z", twist(T_world_sensor[poses].rotation * tilted.inv())[:, None]) * tilted
        R = _chosen(precisions[:, 2] > 0, tilted, turned)
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
        rows = zip(
            self.poses.tolist(), R, t, _root(self.turn), np.sqrt(self.shift)[:, :, None] * np.eye(3), strict=True
        )
        return [factor for row in rows for factor in _prior_factors(*row)]


def known_at(priors: Mapping[int, PosePrior], T_world_sensor: RigidTransform) -> list[KnownPose]:
    """What instruments tell of poses, as if they had measured an estimate of all N: nothing at all of what they do not
    measure."""
    if not priors:
        return []
    poses = np.array(sorted(priors), np.intp)
    T, precisions = T_world_sensor[poses], 1 / np.stack([priors[k].sigmas for k in poses.tolist()]) ** 2
    return MeasuredPoses(poses, T, turn_information(T.rotation, precisions[:, :3]), precisions[:, 3:]).known()


def _chosen(which: np.ndarray, R: Rotation, other: Rotation) -> Rotation:
    """(n,) rotations: R where `which` says so, else the other."""
    return Rotation.from_quat(np.where(which[:, None], R.as_quat(), other.as_quat()))


def turn_information(R: Rotation, precisions: np.ndarray) -> np.ndarray:
    """(n, 3, 3) about e, of R_true = R Exp(e) = Exp(w) R with w = Rz(h) v, h the twist of R and v of these precisions
    (n, 3)."""
    M: np.ndarray = (Rotation.from_euler("Z", twist(R)[:, None]).inv() * R).as_matrix()
    return M.swapaxes(1, 2) @ (precisions[:, :, None] * M)
