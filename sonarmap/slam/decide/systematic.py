"""An error that all fixes of a survey share: places along the vehicle's own axes, headings turned by an angle, a clock
that is off, places that drift.

A lever arm that was left out or has the wrong sign does the first; a declination, a grid's North, or a sonar that is
mounted turned the second. What one does looks, on some tracks, much like what another does: all are tried.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.trajectory import Trajectory

# Residuals beyond so many sigmas count ever less.
_FAR = 2.0
# No lever arm is longer [m], no heading off by more [rad], no clock [s], and no place drifts faster [m/s].
_MOST = np.array([15.0, 15.0, 1.0, 5.0, 0.1, 0.1])
# Of vehicles' lever arms, as a standard deviation [m]; of nothing else is it known what is usual. Over a flat bed,
# where registrations are off, an arm of 8.6 m explained them.
_USUAL_ARM = 3.0
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
        return float(np.hypot(self.forward, self.left) / _USUAL_ARM) ** 2

    @property
    def is_likely(self) -> bool:
        """Whether a vehicle can have it: larger ones are exchanged axes and the like."""
        return bool((np.abs(self.numbers) <= _MOST).all())


def fit_error(
    at: Trajectory,
    poses: np.ndarray,
    residuals: np.ndarray,
    sigmas: np.ndarray,
    known: tuple[np.ndarray, np.ndarray],
    free: tuple[int, ...],
) -> tuple[float, np.ndarray]:
    """The error that explains most of fixes beside an estimate that is turned and moved as a whole, and by how much
    robust chi-squared falls with it.

    Args:
        at: the estimate.
        poses: (n,) which of its poses the fixes are of.
        residuals: (n, 6) how far they are from what was measured, as errors of a `PosePrior` [rad, m].
        sigmas: (n, 6) standard deviations of what was measured.
        known: (n,) bool each, which headings and which places were measured.
        free: which of the error's numbers are fitted.

    Returns:
        The fall, and the (6,) `numbers`.
    """
    headed, placed = known
    x = at.T_world_sensor.translation[poses[placed], :2]
    x = x - x.mean(axis=0)
    of_vehicle, of_world = np.split(_shifts(at, poses[placed]), [4])  # those that turn with the estimate, and others
    off, turned = residuals[placed][:, 3:5], residuals[headed][:, 2]
    of_places, of_turns = sigmas[placed][:, 3:5], sigmas[headed][:, 2]

    def far(fitted: np.ndarray, free: tuple[int, ...]) -> np.ndarray:
        """Of a turn and a shift of the estimate, and the errors that are free."""
        error = np.zeros(len(_MOST))
        error[list(free)] = fitted[3:]
        c, s = np.cos(fitted[0]), np.sin(fitted[0])
        moved = (x - np.tensordot(error[:4], of_vehicle, 1)) @ np.array([[c, s], [-s, c]]) - x + fitted[1:3]
        moved += off - np.tensordot(error[4:], of_world, 1)
        return np.concatenate([(moved / of_places).ravel(), (turned + fitted[0] - error[2]) / of_turns])

    def fit(free: tuple[int, ...]) -> tuple[float, np.ndarray]:
        start = np.zeros(3 + len(free))
        # where most are far off all weigh alike at first
        usual = max(1.0, float(np.median(np.abs(far(start, free)))))
        for scale in (_FAR * usual, _FAR):
            result = least_squares(far, start, x_scale="jac", loss="cauchy", f_scale=scale, args=(free,))
            start = result.x
        return 2 * float(result.cost), start[3:]

    (without, _), (cost, fitted) = fit(()), fit(free)
    return without - cost, np.bincount(free, fitted, minlength=len(_MOST))


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
