# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
"""What is known of single poses beside the edges, whoever measured it, as factors of a graph."""

from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError

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

    Attributes:
        pose: its index.
        T_world_pose: as measured.
        information: (6, 6) of (w, v) [1/rad^2, 1/m^2], symmetric; 0 in directions that are not known.

    Raises:
        InputError: an information that is not finite, symmetric and positive semidefinite.
    """

    pose: int
    T_world_pose: RigidTransform
    information: np.ndarray

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
            return [gtsam.PriorFactorPose3(self.pose, gtsam.Pose3(gtsam.Rot3(R), t), _noise(self.information))]
        factors: list[gtsam.NonlinearFactor] = []
        if turn.any():
            factors.append(gtsam.PoseRotationPrior3D(self.pose, gtsam.Rot3(R), _noise(turn)))
        if shift.any():
            factors.append(gtsam.PoseTranslationPrior3D(self.pose, t, _noise(shift)))
        return factors


def held_pose(pose: int, T_world_pose: RigidTransform, free: np.ndarray) -> KnownPose:
    """One pose held where it is along what is `free`, (6, k) orthonormal columns of (w, v) as `KnownPose` has them."""
    return KnownPose(pose, T_world_pose, free @ free.T / _HELD**2)


def _noise(information: np.ndarray) -> gtsam.noiseModel.Base:
    """Gaussian noise by a semidefinite information."""
    values, axes = np.linalg.eigh(information)
    return gtsam.noiseModel.Gaussian.SqrtInformation(np.sqrt(np.maximum(values, 0.0))[:, None] * axes.T, False)


def blocks(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(6, 6) of a (3, 3) matrix for turns and one for shifts."""
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = turn, shift
    return both
