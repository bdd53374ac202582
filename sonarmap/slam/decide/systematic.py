"""A systematic error that all fixes of a survey share: a lever arm, a turn of all headings, a clock's offset, a drift,
another scale than the ranges.

A lever arm was left out or has the wrong sign; headings are turned by a declination, grid North, or a sonar that is
mounted turned; ranges were computed with a wrong speed of sound. On some tracks these kinds have similar effects, so
all are tried.

The error's numbers are unknowns beside the poses. With the poses eliminated (Schur complement), a Gauss-Newton step of
any of them and the fall of chi-squared need no further optimization.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.trajectory import Trajectory

# Standard deviation of each number of an error among vehicles [m, m, rad, s, m/s, m/s, 1].
_USUAL = np.array([3.0, 3.0, 0.2, 1.0, 0.05, 0.05, 0.03])
_MAX_SIGMAS = 5.0  # of a plausible error; a larger one is an exchanged axis, for example
# Numbers of an error that are estimated together: lever arm, turn, clock, drift, scale.
SCALE = 6
KINDS_OF_ERROR = ((0, 1), (2,), (3,), (4, 5), (SCALE,))
_MAX_GAP = 4.0  # between scans that show a velocity [median intervals]


@dataclass(frozen=True, slots=True)
class Systematic:
    """An error that all fixes share."""

    forward: float = 0.0  # forward, left: how far positions are too far back and right in the sensor's axes [m]
    left: float = 0.0
    turn: float = 0.0  # how far headings are turned clockwise [rad]
    late: float = 0.0  # how much older positions are than their stamps [s]
    drift_east: float = 0.0  # drift_east, drift_north: how fast positions drift to the west and south [m/s]
    drift_north: float = 0.0
    longer: float = 0.0  # share of the map's lengths by which they, like the ranges, are longer than the fixes say
    alternative: "Systematic | None" = None  # another error that explains the fixes about as well, if any

    @property
    def numbers(self) -> np.ndarray:
        """(7,) in the order of the fields [m, m, rad, s, m/s, m/s, 1]."""
        drift = self.drift_east, self.drift_north
        return np.array([self.forward, self.left, self.turn, self.late, *drift, self.longer])

    def corrected(self, T_measured: RigidTransform, at: Trajectory, poses: np.ndarray) -> RigidTransform:
        """n measured poses without the error; `at` is the estimate, `poses` (n,) are their indices in it."""
        shift = np.tensordot(self.numbers, _shifts(at, poses), 1)
        R = Rotation.from_euler("Z", self.turn) * T_measured.rotation
        return RigidTransform.from_components(T_measured.translation + shift, R)

    @property
    def unlikeliness(self) -> float:
        """Chi-squared of its numbers, by their usual size."""
        return float(((self.numbers / _USUAL) ** 2).sum())

    @property
    def is_likely(self) -> bool:
        """Whether its size is plausible for a vehicle."""
        return bool((np.abs(self.numbers) <= _MAX_SIGMAS * _USUAL).all())


@dataclass(frozen=True, slots=True)
class SharedError:
    """The quadratic cost of an error's numbers, with the poses optimized for every error."""

    information: np.ndarray  # (7, 7)
    gradient: np.ndarray  # (7,)

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
        """Linearized at an optimum of N poses.

        Args:
            at: the optimum.
            of_poses: (6 N, 6 N) its information, of body tangents.
            poses: (n,) indices of the poses with fixes.
            residuals: (n, 6) of the fixes, as errors of a `PosePrior` [rad, m].
            precisions: (n, 6) inverse variances of these in the optimum [1/rad^2, 1/m^2]; 0 where not measured.
            error: by which the fixes are already corrected.
        """
        R = np.asarray(at.T_world_sensor.rotation.as_matrix())[poses]
        # derivatives of heading, east, north and up by the pose, and by the error's numbers
        by_pose, by_error = np.zeros((len(poses), 4, 6)), np.zeros((len(poses), 4, len(_USUAL)))
        by_pose[:, 0, :3], by_pose[:, 1:, 3:] = R[:, 2], R
        by_error[:, 0, 2], by_error[:, 1:] = -1.0, -_shifts(at, poses).transpose(1, 2, 0)
        weighted = precisions[:, 2:, None] * by_error
        coupled = np.zeros((len(at), 6, len(_USUAL)))
        coupled[poses] = np.einsum("nra,nrb->nab", by_pose, weighted)
        coupled = coupled.reshape(-1, len(_USUAL))
        information = np.einsum("nra,nrb->ab", by_error, weighted) - coupled.T @ splu(of_poses).solve(coupled)
        gradient = np.einsum("nr,nra->a", residuals[:, 2:], weighted)
        return cls(information + np.diag(_USUAL**-2), gradient + error.numbers / _USUAL**2)

    def step(self, free: tuple[int, ...]) -> tuple[float, np.ndarray]:
        """The fall of chi-squared with the best change of the `free` numbers, and the (7,) change."""
        step = np.zeros(len(_USUAL))
        step[list(free)] = -np.linalg.solve(self.information[np.ix_(free, free)], self.gradient[list(free)])
        return float(-self.gradient @ step), step


def _shifts(at: Trajectory, poses: np.ndarray) -> np.ndarray:
    """(7, n, 3) derivatives of positions, east, north and up, by each of an error's numbers."""
    axes = np.asarray(at.T_world_sensor.rotation.as_matrix())[poses, :2]
    elapsed, places = at.stamps[poses] - at.stamps[poses].mean(), at.T_world_sensor.translation[poses]
    shifts = np.zeros((len(_USUAL), len(poses), 3))
    shifts[:2, :, :2] = np.moveaxis(axes[..., :2], -1, 0)
    shifts[3, :, :2] = _velocities(at)[poses]
    shifts[4, :, 0] = shifts[5, :, 1] = elapsed
    shifts[SCALE] = places - places.mean(axis=0)
    return shifts


def _velocities(at: Trajectory) -> np.ndarray:
    """(N, 2) velocity of the sensor, east and north, between the scan before and the next one [m/s]."""
    seconds, steps = np.diff(at.stamps), np.diff(at.T_world_sensor.translation[:, :2], axis=0)
    later = seconds > 0
    usable = later & (seconds <= _MAX_GAP * float(np.median(seconds[later])) if later.any() else later)
    seconds, steps = np.where(usable, seconds, 0.0), np.where(usable[:, None], steps, 0.0)
    around = np.pad(seconds, 1)
    both = around[1:] + around[:-1]
    moved = np.pad(steps, ((1, 1), (0, 0)))
    return (moved[1:] + moved[:-1]) / np.where(both > 0, both, 1.0)[:, None]
