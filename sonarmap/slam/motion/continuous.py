"""The sensor's pose at any time between the scans: a Gaussian process with white noise on acceleration (Barfoot, Tong
and Särkkä 2014, DOI 10.15607/RSS.2014.X.001).

Between scans a pose is T_k Exp(y(t) - y_k), where y sums up the steps log(T_k^-1 T_k+1) in the sensor's axes. Under
this process the mean of y is the natural cubic spline through the scans, and its variance is known in closed form.

The rotation measured by a gyroscope is removed first. The remaining rotation, drift of the gyroscope and errors of the
scans, is smooth.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.turn_rates import Turned, TurnRates

_MIN_POSES = 3  # to learn more than a steady motion
_RATIOS = np.geomspace(1e-4, 1e2, 25)  # of white noise to the density of accelerations [cubed spans]


@dataclass(frozen=True, slots=True)
class ContinuousTrajectory:
    """The trajectory of one sensor, without gaps.

    Attributes:
        knots: n poses with ascending stamps [s].
        covariances: (n, 6, 6) of the knots, rotation first [rad, m], body tangent.
        spline: y, (6,) rotation first [rad, m], over the stamps.
        power: (6,) spectral density of the acceleration [rad^2/s^3, m^2/s^3].
        of_velocity: (n,) variances of the knots' velocities and (n - 1,) covariances of consecutive ones, for a density
            of 1 [s^-1].
        turned: the measured rotation, which is removed from the knots; None without turn rates.
    """

    knots: Trajectory
    covariances: np.ndarray
    spline: CubicSpline
    power: np.ndarray
    of_velocity: tuple[np.ndarray, np.ndarray]
    turned: Turned | None = None

    @classmethod
    def through(
        cls, knots: Trajectory, covariances: np.ndarray, rates: TurnRates | None = None
    ) -> "ContinuousTrajectory":
        """Through two poses or more, with the most likely density.

        Turn rates shape the rotation between the poses if they cover all stamps, and if the poses turn more smoothly
        with the measured rotation removed: else the rates are of another sensor, clock or frame.

        Raises:
            InputError: fewer poses, or stamps that do not ascend.
        """
        stamps, T = knots.stamps, knots.T_world_sensor
        if len(stamps) < 2 or not (np.diff(stamps) > 0).all():
            raise InputError(
                f"{len(stamps)} poses with stamps from {stamps[0]:g} to {stamps[-1]:g} s give no trajectory; "
                "wanted two or more, whose stamps ascend"
            )
        steps = np.asarray((T[:-1].inv() * T[1:]).as_exp_coords())
        y = np.concatenate([np.zeros((1, 6)), np.cumsum(steps, axis=0)])
        spline = CubicSpline(stamps, y, bc_type="natural")
        acceleration = spline(stamps, 2)  # linear between knots
        spans = np.diff(stamps)
        energy = spans @ (acceleration[:-1] ** 2 + acceleration[:-1] * acceleration[1:] + acceleration[1:] ** 2) / 3
        power = energy / max(len(stamps) - 2, 1) if len(stamps) >= _MIN_POSES else np.zeros(6)
        plain = cls(knots, covariances, spline, power, _velocity_variances(spans))
        if rates is None or len(stamps) < _MIN_POSES or not rates.cover(stamps):
            return plain
        turned = rates.turned(stamps, T.rotation)
        R = RigidTransform.from_rotation(turned.at(stamps))
        without_turn = cls.through(Trajectory(stamps, T * R.inv()), propagated(R, covariances))
        smoother = without_turn.power[:3].sum() < plain.power[:3].sum()
        return replace(without_turn, turned=turned) if smoother else plain

    @property
    def shaken(self) -> np.ndarray:
        """(6,) variance of white noise of the knots about a smooth motion [rad^2, m^2].

        Changes of velocity at knots have the covariance power R + shaken Q'Q, with the matrices of Green and Silverman
        1994, Sect. 2.1; the ratio of both variances is the most likely one.
        """
        stamps = self.knots.stamps
        spans, best, shaken = np.diff(stamps), np.full(6, np.inf), np.zeros(6)
        changes = np.diff(np.diff(self.spline(stamps), axis=0) / spans[:, None], axis=0)
        if len(stamps) < _MIN_POSES:
            return shaken
        smooth, noise, per = np.zeros((3, len(changes))), np.zeros((3, len(changes))), 1 / spans
        smooth[0], smooth[1, :-1] = (spans[:-1] + spans[1:]) / 3, spans[1:-1] / 6
        noise[0] = per[:-1] ** 2 + (per[:-1] + per[1:]) ** 2 + per[1:] ** 2
        noise[1, :-1] = -per[1:-1] * (per[:-2] + 2 * per[1:-1] + per[2:])
        noise[2, :-2] = per[1:-2] * per[2:-1]
        for ratio in np.append(0.0, _RATIOS * np.median(spans) ** 3):
            factor = cholesky_banded(smooth + ratio * noise, lower=True)
            power = np.maximum((changes * cho_solve_banded((factor, True), changes)).mean(axis=0), 1e-30)
            unlikelihood = np.log(power) + 2 * np.log(factor[0]).mean()
            shaken = np.where(unlikelihood < best, ratio * power, shaken)
            best = np.minimum(unlikelihood, best)
        return shaken

    def at(self, stamps: np.ndarray) -> tuple[Trajectory, np.ndarray]:
        """The poses at (m,) stamps [s], and their covariances, (m, 6, 6), as those of the knots.

        Before the first pose and after the last one the motion is steady, for at most the interval next to it.

        Raises:
            InputError: a stamp farther before the first pose or after the last.
        """
        known, requested = self.knots.stamps, stamps
        if len(stamps) and not (2 * known[0] - known[1] <= stamps.min() and stamps.max() <= 2 * known[-1] - known[-2]):
            raise InputError(
                f"poses from {stamps.min():g} to {stamps.max():g} s were requested; the trajectory is known "
                f"from {known[0]:g} to {known[-1]:g} s"
            )
        stamps = np.clip(requested, known[0], known[-1])
        beyond = requested - stamps
        k = np.clip(np.searchsorted(known, stamps, side="right") - 1, 0, len(known) - 2)
        span = known[k + 1] - known[k]
        share = (stamps - known[k]) / span
        T = self.knots.T_world_sensor
        before, behind = (self.spline(stamps) - self.spline(known[end]) for end in (k, k + 1))
        poses = T[k] * RigidTransform.from_exp_coords(before)
        # uncertainties of both knots, seen from the pose, and of the motion between
        first, second = (
            propagated(RigidTransform.from_exp_coords(-y), self.covariances[end])
            for y, end in ((before, k), (behind, k + 1))
        )
        both = (1 - share)[:, None, None] * first + share[:, None, None] * second
        between = np.zeros_like(both)
        of_velocity = self.of_velocity[0][np.where(beyond < 0, k, k + 1)]
        variance = self._variance(k, span, share) + beyond**2 * of_velocity + np.abs(beyond) ** 3 / 3
        between[:, range(6), range(6)] = variance[:, None] * self.power
        if self.turned is not None:  # a random walk, which the next pose corrects
            walked = np.abs(beyond) + share * (1 - share) * span
            between[:, range(3), range(3)] += self.turned.wander * walked[:, None]
        steady = RigidTransform.from_exp_coords(beyond[:, None] * self.spline(stamps, 1))
        covariances = propagated(steady.inv(), both) + between
        poses = poses * steady
        if self.turned is not None:
            R = RigidTransform.from_rotation(self.turned.at(requested))
            poses, covariances = poses * R, propagated(R.inv(), covariances)
        return Trajectory(requested.astype(np.float64), poses), covariances

    def _variance(self, k: np.ndarray, span: np.ndarray, share: np.ndarray) -> np.ndarray:
        """(m,) variance of y at shares of the spans after knots k, for a density of 1 [s^3]."""
        own, shared = self.of_velocity
        of_first, of_second = share * (1 - share) ** 2 * span, -(share**2) * (1 - share) * span
        by_velocities = of_first**2 * own[k] + of_second**2 * own[k + 1] + 2 * of_first * of_second * shared[k]
        return by_velocities + (share * (1 - share) * span) ** 3 / 3


def _velocity_variances(spans: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) variances and (n - 1,) covariances of neighbors, of velocities at knots with `spans` [s] between, for a
    density of 1. Their information is tridiagonal: 4 / span on the diagonal for each side, 2 / span beside it."""
    diagonal = 4 * (np.append(1 / spans, 0.0) + np.insert(1 / spans, 0, 0.0))
    beside = 2 / spans
    ahead, back = diagonal.copy(), diagonal.copy()  # pivots from either end
    for k in range(1, len(diagonal)):
        ahead[k] -= beside[k - 1] ** 2 / ahead[k - 1]
    for k in range(len(diagonal) - 2, -1, -1):
        back[k] -= beside[k] ** 2 / back[k + 1]
    own = 1 / (ahead + back - diagonal)
    return own, -beside * own[:-1] / back[1:]
