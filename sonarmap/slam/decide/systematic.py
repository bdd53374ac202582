"""An error that all fixes of a survey share: places along the vehicle's own axes, headings turned by an angle, a clock
that is off, places that drift.

A lever arm that was left out or has the wrong sign does the first; a declination, a grid's North, or a sonar that is
mounted turned the second. What one does looks, on some tracks, much like what another does: all are tried.

The error's numbers are unknowns beside the poses. With the poses eliminated (Schur complement), a Gauss-Newton step of
any of them, and by how much chi-squared falls with it, cost no further optimization.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.trajectory import Trajectory

# Standard deviation of each number of an error among vehicles [m, m, rad, s, m/s, m/s]. Over a flat bed, where
# registrations are off, an arm of 8.6 m would explain them.
_USUAL = np.array([3.0, 3.0, 0.2, 1.0, 0.05, 0.05])
_MOST = 5.0  # what is larger by so many of these is an exchanged axis or the like
# Which numbers of an error are free together: lever arm, turn, clock, drift.
KINDS_OF_ERROR = ((0, 1), (2,), (3,), (4, 5))
# Scans farther apart in time than so many times what is usual say nothing of how fast the vehicle was.
_GAP = 4.0


@dataclass(frozen=True, slots=True)
class Systematic:
    """What all fixes are off by."""

    forward: float = 0.0  # forward, left: that places lie too far back and right along the sensor's axes [m]
    left: float = 0.0
    turn: float = 0.0  # that headings are turned clockwise too far [rad]
    late: float = 0.0  # that places are where the vehicle was so long before [s]
    drift_east: float = 0.0  # drift_east, drift_north: that places drift to the West and South [m/s]
    drift_north: float = 0.0
    alternative: "Systematic | None" = None  # what explains the fixes about as well; None where nothing does

    @property
    def numbers(self) -> np.ndarray:
        """(6,) in their order [m, m, rad, s, m/s, m/s]."""
        return np.array([self.forward, self.left, self.turn, self.late, self.drift_east, self.drift_north])

    def corrected(self, T_measured: RigidTransform, at: Trajectory, poses: np.ndarray) -> RigidTransform:
        """n measured poses without the error, beside the estimate's `poses` (n,)."""
        shift = np.pad(np.tensordot(self.numbers, _shifts(at, poses), 1), ((0, 0), (0, 1)))
        R = Rotation.from_euler("Z", self.turn) * T_measured.rotation
        return RigidTransform.from_components(T_measured.translation + shift, R)

    @property
    def unlikeliness(self) -> float:
        """What it adds to chi-squared by itself."""
        return float(((self.numbers / _USUAL) ** 2).sum())

    @property
    def is_likely(self) -> bool:
        """Whether a vehicle can have it: larger ones are exchanged axes and the like."""
        return bool((np.abs(self.numbers) <= _MOST * _USUAL).all())


@dataclass(frozen=True, slots=True)
class SharedError:
    """The quadratic cost of an error's numbers, with the poses at their best for every error."""

    information: np.ndarray  # (6, 6)
    gradient: np.ndarray  # (6,)

    @classmethod
    def of(
        cls,
        at: Trajectory,
        of_poses: sparse.csc_array,
        poses: np.ndarray,
        residuals: np.ndarray,
        precisions: np.ndarray,
        error: Systematic,
    ) -> "SharedError":
        """About an optimum of N poses.

        Args:
            at: the optimum.
            of_poses: (6 N, 6 N) its information, of body tangents.
            poses: (n,) which of its poses the fixes are of.
            residuals: (n, 6) of the fixes, as errors of a `PosePrior` [rad, m].
            precisions: (n, 6) of these, with which they entered [1/rad^2, 1/m^2]; 0 where not measured.
            error: what the fixes were corrected by before.
        """
        R = np.asarray(at.T_world_sensor.rotation.as_matrix())[poses]
        # derivatives of heading, East and North with respect to the pose, and to the error's numbers
        by_pose, by_error = np.zeros((len(poses), 3, 6)), np.zeros((len(poses), 3, len(_USUAL)))
        by_pose[:, 0, :3], by_pose[:, 1:, 3:] = R[:, 2], R[:, :2]
        by_error[:, 0, 2], by_error[:, 1:] = -1.0, -_shifts(at, poses).transpose(1, 2, 0)
        weighted = precisions[:, 2:5, None] * by_error
        coupled = np.zeros((len(at), 6, len(_USUAL)))
        coupled[poses] = np.einsum("nra,nrb->nab", by_pose, weighted)
        coupled = coupled.reshape(-1, len(_USUAL))
        information = np.einsum("nra,nrb->ab", by_error, weighted) - coupled.T @ splu(of_poses).solve(coupled)
        gradient = np.einsum("nr,nra->a", residuals[:, 2:5], weighted)
        return cls(information + np.diag(_USUAL**-2), gradient + error.numbers / _USUAL**2)

    def step(self, free: tuple[int, ...]) -> tuple[float, np.ndarray]:
        """By how much chi-squared falls with the best change of the `free` numbers, and the (6,) change."""
        step = np.zeros(len(_USUAL))
        step[list(free)] = -np.linalg.solve(self.information[np.ix_(free, free)], self.gradient[list(free)])
        return float(-self.gradient @ step), step

    def rise_without(self, kind: tuple[int, ...], kinds: Sequence[tuple[int, ...]], error: Systematic) -> float:
        """By how much chi-squared rises without the numbers of one kind, the others of `kinds` at their best."""
        free = [number for each in kinds for number in each]
        covariance = np.linalg.inv(self.information[np.ix_(free, free)])
        own = [free.index(number) for number in kind]
        x = error.numbers[list(kind)]
        return float(x @ np.linalg.solve(covariance[np.ix_(own, own)], x))


def _shifts(at: Trajectory, poses: np.ndarray) -> np.ndarray:
    """(6, n, 2) by how much places move to the East and North with each of an error's numbers."""
    axes = np.asarray(at.T_world_sensor.rotation.as_matrix())[poses, :2]
    still = np.zeros((len(poses), 2))
    passed = (at.stamps[poses] - at.stamps[poses].mean())[:, None]
    return np.stack(
        [axes[..., 0], axes[..., 1], still, _velocities(at)[poses], passed * [1.0, 0.0], passed * [0.0, 1.0]]
    )


def _velocities(at: Trajectory) -> np.ndarray:
    """(N, 2) how fast the sensor moves to the East and North from the scan before to the next one [m/s]."""
    seconds, steps = np.diff(at.stamps), np.diff(at.T_world_sensor.translation[:, :2], axis=0)
    later = seconds > 0
    told = later & (seconds <= _GAP * float(np.median(seconds[later])) if later.any() else later)
    seconds, steps = np.where(told, seconds, 0.0), np.where(told[:, None], steps, 0.0)
    around = np.pad(seconds, 1)
    both = around[1:] + around[:-1]
    moved = np.pad(steps, ((1, 1), (0, 0)))
    return (moved[1:] + moved[:-1]) / np.where(both > 0, both, 1.0)[:, None]
