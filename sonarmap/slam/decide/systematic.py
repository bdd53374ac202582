"""An error that all fixes of a survey share: places along the vehicle's own axes, or headings turned by an angle.

The first is what a lever arm does that was left out or has the wrong sign, and at a steady speed a clock that is off;
the second a declination, a grid's North, or a sonar that is mounted turned. On a closed track one looks much like the
other, so that both are tried.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

# Residuals beyond so many sigmas count ever less.
_FAR = 2.0
# No lever arm is longer [m], no heading off by more [rad].
_LONGEST, _MOST_TURNED = 15.0, 1.0
# Which of (forward, left, turn) are free.
KINDS_OF_ERROR = ((0, 1), (2,))


@dataclass(frozen=True, slots=True)
class Systematic:
    """What all fixes are off by."""

    forward: float = 0.0  # forward, left: that places lie too far back and right along the sensor's axes [m]
    left: float = 0.0
    turn: float = 0.0  # that headings are turned clockwise too far [rad]
    alternative: "Systematic | None" = None  # what explains the fixes about as well; None where nothing does

    def corrected(self, T_measured: RigidTransform, R_world_sensor: Rotation) -> RigidTransform:
        """n measured poses without the error, beside the estimate's rotations."""
        shift = R_world_sensor.apply([self.forward, self.left, 0.0]) * [1.0, 1.0, 0.0]
        R = Rotation.from_euler("Z", self.turn) * T_measured.rotation
        return RigidTransform.from_components(T_measured.translation + shift, R)

    def plus(self, other: "Systematic") -> "Systematic":
        """Both together."""
        return replace(
            self, forward=self.forward + other.forward, left=self.left + other.left, turn=self.turn + other.turn
        )

    @property
    def is_likely(self) -> bool:
        """Whether a vehicle can have it: larger ones are exchanged axes and the like."""
        return max(abs(self.forward), abs(self.left)) <= _LONGEST and abs(self.turn) <= _MOST_TURNED

    @property
    def size(self) -> float:
        """How far it moves anything, for what has converged [m, rad]."""
        return max(abs(self.forward), abs(self.left), abs(self.turn))


def fit_error(
    T: RigidTransform,
    residuals: np.ndarray,
    sigmas: np.ndarray,
    known: tuple[np.ndarray, np.ndarray],
    free: tuple[int, ...],
) -> tuple[float, Systematic]:
    """The error that explains most of fixes beside an estimate that is turned and moved as a whole, and by how much
    robust chi-squared falls with it.

    Args:
        T: n poses of the estimate, T_world_sensor.
        residuals: (n, 6) how far they are from what was measured, in the world's axes [rad, m].
        sigmas: (n, 6) standard deviations of what was measured.
        known: (n,) bool each, which headings and which places were measured.
        free: which of (forward, left, turn) are fitted.
    """
    headed, placed = known
    x = T.translation[placed][:, :2]
    x = x - x.mean(axis=0)
    axes = np.asarray(T.rotation.as_matrix())[placed][:, :2, :2]
    off, turned = residuals[placed][:, 3:5], residuals[headed][:, 2]
    of_places, of_turns = sigmas[placed][:, 3:5], sigmas[headed][:, 2]

    def far(fitted: np.ndarray, free: tuple[int, ...]) -> np.ndarray:
        """Of a turn and a shift of the estimate, and the errors that are free."""
        error = np.zeros(3)
        error[list(free)] = fitted[3:]
        c, s = np.cos(fitted[0]), np.sin(fitted[0])
        R = np.array([[c, -s], [s, c]])
        moved = off + x @ R.T - x + fitted[1:3] - axes @ error[:2] @ R.T
        return np.concatenate([(moved / of_places).ravel(), (turned + fitted[0] - error[2]) / of_turns])

    def fit(free: tuple[int, ...]) -> tuple[float, np.ndarray]:
        start = np.zeros(3 + len(free))
        # where most are far off all weigh alike at first
        usual = max(1.0, float(np.median(np.abs(far(start, free)))))
        for scale in (_FAR * usual, _FAR):
            result = least_squares(far, start, loss="cauchy", f_scale=scale, args=(free,))
            start = result.x
        return 2 * float(result.cost), start[3:]

    (without, _), (cost, fitted) = fit(()), fit(free)
    forward, left, turn = np.bincount(free, fitted, minlength=3).tolist()
    return without - cost, Systematic(forward, left, turn)
