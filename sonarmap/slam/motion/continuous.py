"""The sensor at any time, between the scans: a Gaussian process whose velocity is as likely to change one way as the
other (white noise on acceleration; Barfoot, Tong and Särkkä 2014, DOI 10.15607/RSS.2014.X.001).

Between scans a pose is T_k Exp(y(t) - y_k), where y sums up the steps log(T_k^-1 T_k+1) in the sensor's own axes. Under
such a process the mean of y through the scans is the natural cubic spline, and its variance is known in closed form.

Turn rates of a gyroscope take their part before: all this is then of a frame that they would have kept from turning,
and what they leave over, drift of the gyroscope and errors of the scans, is smooth.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.turn_rates import Turned, TurnRates

_FEWEST = 3  # poses from which more than a steady motion is learned


@dataclass(frozen=True, slots=True)
class ContinuousTrajectory:
    """The way of one sensor without a break.

    Attributes:
        knots: n poses with ascending stamps [s].
        covariances: (n, 6, 6) of these, rotation first [rad, m], body tangent.
        spline: y, (6,) rotation first [rad, m], of the stamps.
        power: (6,) how much the velocity wanders: the spectral density of the acceleration [rad^2/s^3, m^2/s^3].
        of_velocity: (n,) and (n - 1,), variances of the knots' velocities and covariances of two in a row, for a
            density of 1 [s^-1].
        turned: how the sensor has turned by measured rates, which the knots are without; None where they are none.
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
        """Through two poses or more; the density is the likeliest one.

        Turn rates shape the rotation between the poses where they are known all along, and where these turn more
        smoothly without them than with them: else they are of another sensor, clock or frame.

        Raises:
            InputError: fewer poses, or stamps that do not ascend.
        """
        stamps, T = knots.stamps, knots.T_world_sensor
        if len(stamps) < 2 or not (np.diff(stamps) > 0).all():
            raise InputError(
                f"{len(stamps)} poses with stamps from {stamps[0]:g} to {stamps[-1]:g} s tell no way between them; "
                "wanted two or more, whose stamps ascend"
            )
        steps = np.asarray((T[:-1].inv() * T[1:]).as_exp_coords())
        y = np.concatenate([np.zeros((1, 6)), np.cumsum(steps, axis=0)])
        spline = CubicSpline(stamps, y, bc_type="natural")
        bent = spline(stamps, 2)  # linear between knots
        spans = np.diff(stamps)
        energy = spans @ (bent[:-1] ** 2 + bent[:-1] * bent[1:] + bent[1:] ** 2) / 3
        power = energy / max(len(stamps) - 2, 1) if len(stamps) >= _FEWEST else np.zeros(6)
        plain = cls(knots, covariances, spline, power, _velocity_variances(spans))
        if rates is None or len(stamps) < _FEWEST or not rates.cover(stamps):
            return plain
        turned = rates.turned(stamps, T.rotation)
        R = RigidTransform.from_rotation(turned.at(stamps))
        still = cls.through(Trajectory(stamps, T * R.inv()), propagated(R, covariances))
        smoother = still.power[:3].sum() < plain.power[:3].sum()
        return replace(still, turned=turned) if smoother else plain

    def at(self, stamps: np.ndarray) -> tuple[Trajectory, np.ndarray]:
        """The poses at (m,) stamps [s], and their covariances, (m, 6, 6), as those of the knots.

        Before the first pose and behind the last the motion is steady, as long as from the one next to it at most.

        Raises:
            InputError: a stamp farther before the first pose or after the last.
        """
        known, asked = self.knots.stamps, stamps
        if len(stamps) and not (2 * known[0] - known[1] <= stamps.min() and stamps.max() <= 2 * known[-1] - known[-2]):
            raise InputError(
                f"poses are asked for from {stamps.min():g} to {stamps.max():g} s, and known from {known[0]:g} to "
                f"{known[-1]:g} s"
            )
        stamps = np.clip(asked, known[0], known[-1])
        beyond = asked - stamps
        k = np.clip(np.searchsorted(known, stamps, side="right") - 1, 0, len(known) - 2)
        span = known[k + 1] - known[k]
        share = (stamps - known[k]) / span
        T = self.knots.T_world_sensor
        before, behind = (self.spline(stamps) - self.spline(known[end]) for end in (k, k + 1))
        poses = T[k] * RigidTransform.from_exp_coords(before)
        # of both knots as they are seen from there, and of the way between
        first, second = (
            propagated(RigidTransform.from_exp_coords(-y), self.covariances[end])
            for y, end in ((before, k), (behind, k + 1))
        )
        both = (1 - share)[:, None, None] * first + share[:, None, None] * second
        between = np.zeros_like(both)
        of_velocity = self.of_velocity[0][np.where(beyond < 0, k, k + 1)]
        variance = self._variance(k, span, share) + beyond**2 * of_velocity + np.abs(beyond) ** 3 / 3
        between[:, range(6), range(6)] = variance[:, None] * self.power
        if self.turned is not None:  # a random walk that the next pose ends
            walked = np.abs(beyond) + share * (1 - share) * span
            between[:, range(3), range(3)] += self.turned.wander * walked[:, None]
        steady = RigidTransform.from_exp_coords(beyond[:, None] * self.spline(stamps, 1))
        covariances = propagated(steady.inv(), both) + between
        poses = poses * steady
        if self.turned is not None:
            R = RigidTransform.from_rotation(self.turned.at(asked))
            poses, covariances = poses * R, propagated(R.inv(), covariances)
        return Trajectory(asked.astype(np.float64), poses), covariances

    def _variance(self, k: np.ndarray, span: np.ndarray, share: np.ndarray) -> np.ndarray:
        """(m,) variance of y at these shares of the spans behind knots k, for a density of 1 [s^3]."""
        own, shared = self.of_velocity
        of_first, of_second = share * (1 - share) ** 2 * span, -(share**2) * (1 - share) * span
        by_velocities = of_first**2 * own[k] + of_second**2 * own[k + 1] + 2 * of_first * of_second * shared[k]
        return by_velocities + (share * (1 - share) * span) ** 3 / 3


def _velocity_variances(spans: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) variances and (n - 1,) covariances of neighbors, of velocities at knots so far apart [s], where the density
    is 1: of the tridiagonal information, 4 / span on the diagonal for each side and 2 / span beside it, the inverse."""
    diagonal = 4 * (np.append(1 / spans, 0.0) + np.insert(1 / spans, 0, 0.0))
    beside = 2 / spans
    ahead, back = diagonal.copy(), diagonal.copy()  # pivots from either end
    for k in range(1, len(diagonal)):
        ahead[k] -= beside[k - 1] ** 2 / ahead[k - 1]
    for k in range(len(diagonal) - 2, -1, -1):
        back[k] -= beside[k] ** 2 / back[k + 1]
    own = 1 / (ahead + back - diagonal)
    return own, -beside * own[:-1] / back[1:]
