"""Dead reckoning: where the vehicle believes it went, with an error that grows with the way and the time."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.tangent import lengths, propagated
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.chi_squared import chi_squared
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.geometry import rotated
from sonarmap.spectral.result import Registration

# What no dead reckoning is better than, from scan to scan [rad, m].
_FINEST_TURN, _FINEST_WAY = float(np.radians(0.1)), 0.005
# From so many standard deviations on a registration contradicts it.
_CONTRADICTION = 5.0
# Its drift is compared over so many steps in a row, and from so many such stretches on; it is understated where half of
# them show so many times as much or more, of at most so many.
_STEPS, _FEWEST, _UNDERSTATED, _MOST = 8, 8, 1.5, 100.0
_MIDDLE = float(np.sqrt(chi_squared(0.5, 3)))  # the median of three numbers' length [sigmas]


@dataclass(frozen=True, slots=True)
class Odometry:
    """Dead reckoning at the scans' times.

    Attributes:
        scans: (n,) int, ascending: the scans that it covers.
        T_odom_sensor: n poses, in any frame that does not jump.
        times: (n,) [s], of these scans.
        drift: standard deviation of the way, as a share of it.
        turn_drift: standard deviation of the rotation [rad/s].
        understated: how many times more than was stated both are, as registrations show.
        alone: whether consecutive scans share too little to be registered, so that it alone tells their steps.

    Raises:
        InputError: shapes that do not fit, or a drift below 0.
    """

    scans: np.ndarray
    T_odom_sensor: RigidTransform
    times: np.ndarray
    drift: float = 0.01
    turn_drift: float = float(np.radians(10.0) / 3600)
    understated: float = 1.0
    alone: bool = False

    def __post_init__(self) -> None:
        if self.T_odom_sensor.single or not len(self.scans) == len(self.T_odom_sensor) == len(self.times):
            raise InputError("an odometry needs a scan, a pose and a time each")
        if not (self.drift >= 0 and self.turn_drift >= 0):
            raise InputError(f"`drift` {self.drift} and `turn_drift` {self.turn_drift}: wanted 0 or more")

    def tells(self, i: int, j: int) -> bool:
        """Whether it tells how two scans lie to each other."""
        return bool(np.isin([i, j], self.scans).all())

    def take(self, chosen: Sequence[int]) -> "Odometry":
        """Of these scans alone, ascending, which are then numbered 0, 1, ..."""
        rows = np.flatnonzero(np.isin(self.scans, chosen))
        scans = np.searchsorted(np.asarray(chosen), self.scans[rows])
        return replace(self, scans=scans, T_odom_sensor=self.T_odom_sensor[rows], times=self.times[rows])

    def scaled(self, factor: float) -> "Odometry":
        """With so many times as much drift."""
        drifts = {"drift": factor * self.drift, "turn_drift": factor * self.turn_drift}
        return replace(self, **drifts, understated=factor * self.understated)

    def as_registered(self, steps: Sequence[RegisteredPair]) -> "Odometry":
        """With the drift that registrations of consecutive scans show, where it is clearly more than was stated.

        Half of the stretches of a few accepted steps have to be within what dead reckoning and registrations together
        leave half of them, of the rotation and of the translation alike.
        """
        sure = {step.i: step for step in steps if step.accepted and self.tells(*step.scans)}
        apart, by_scans, by_drift = list[np.ndarray](), list[np.ndarray](), list[np.ndarray]()
        for k in sure:
            if all(k + n in sure for n in range(_STEPS)):
                T, covariance = _joined([sure[k + n] for n in range(_STEPS)])
                measured, sigmas = self._between(*np.searchsorted(self.scans, [k, k + _STEPS]).tolist())
                apart.append((T.inv() * measured).as_exp_coords())
                by_scans.append(covariance)
                by_drift.append(rotated(T.rotation.inv(), np.diag(sigmas**2)))
        if len(apart) < _FEWEST:
            return self
        xi, of_scans, of_drift = np.stack(apart), np.stack(by_scans), np.stack(by_drift)
        for factor in np.geomspace(1.0, _MOST, 93).tolist():  # each is 5 % more than the one before
            covariance = of_scans + factor**2 * of_drift
            parts = [lengths(xi[:, part], covariance[:, part, part]) for part in (slice(0, 3), slice(3, 6))]
            if np.median(parts, axis=1).max() <= _MIDDLE:
                return self.scaled(factor) if factor >= _UNDERSTATED else self
        return self.scaled(_MOST)

    def expected(self, i: int, j: int, floor: np.ndarray) -> ExpectedPose:
        """T_i_j and how sure it is: its error is the same all the way, so that it grows with it.

        Args:
            i, j: of scans that it covers.
            floor: (6,) standard deviations that are granted beside [rad, m].
        """
        T, sigmas = self._between(*np.searchsorted(self.scans, [i, j]).tolist())
        return ExpectedPose.along_target(T, np.hypot(sigmas, floor))

    def contradicts(self, i: int, j: int, T_i_j: RigidTransform, floor: np.ndarray) -> bool:
        """Whether a registration is farther from it than its error and a floor allow."""
        expected = self.expected(i, j, floor)
        away = expected.T_target_source
        turn = (away.rotation.inv() * T_i_j.rotation).magnitude() / expected.sigmas[:3].max()
        way = np.linalg.norm(away.translation - T_i_j.translation) / expected.sigmas[3:].max()
        return bool(max(turn, way) > _CONTRADICTION)

    def edges(self, surveys: np.ndarray) -> list[Edge]:
        """Its steps as measurements of a graph, within each survey.

        A graph takes its edges' errors as independent, but dead reckoning errs the same way all along. Each step is
        given the variance with which all together err as much as the whole does.

        Args:
            surveys: (N,) the number of each scan's survey.
        """
        edges = []
        for (a, i), (b, j) in pairwise(enumerate(self.scans.tolist())):
            if surveys[i] != surveys[j]:
                continue
            steps = int((surveys[self.scans] == surveys[i]).sum()) - 1
            T, sigmas = self._between(a, b)
            least = np.repeat([_FINEST_TURN, _FINEST_WAY], 3)
            covariance = np.diag(steps * sigmas**2 + least**2)
            measured = Registration(T, covariance, np.nan, np.nan, accepted=True, seconds=0.0, reason="odometry")
            edges.append(Edge(i, j, measured, "odometry"))
        return edges

    def _between(self, a: int, b: int) -> tuple[RigidTransform, np.ndarray]:
        """T_a_b of two of its poses, and (6,) standard deviations."""
        places = self.T_odom_sensor.translation[a : b + 1]
        way = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
        turn = self.turn_drift * abs(float(self.times[b] - self.times[a]))
        # a turn that grows evenly moves the end by half of it times the way
        sigmas = np.repeat([turn, self.drift * way + turn * way / 2], 3)
        return self.T_odom_sensor[a].inv() * self.T_odom_sensor[b], np.maximum(sigmas, 1e-6)


def _joined(steps: Sequence[RegisteredPair]) -> tuple[RigidTransform, np.ndarray]:
    """From the first step's target to the last one's source, and the covariance in the body tangent there."""
    reached, covariance = RigidTransform.identity(), np.zeros((6, 6))
    for step in steps:
        assert step.registration is not None
        T_step = step.registration.T_target_source
        reached, covariance = reached * T_step, propagated(T_step.inv(), covariance) + step.registration.covariance
    return reached, covariance
