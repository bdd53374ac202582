"""Dead reckoning: the vehicle's own track, with an error that grows with distance and time."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.chi_squared import chi_squared
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.result import Registration

_MIN_TURN_SIGMA = float(np.radians(0.1))  # of dead reckoning from scan to scan [rad]
_MIN_SHIFT_SIGMA = 0.005  # of dead reckoning from scan to scan [m]
_MAX_SIGMAS = 5.0  # of a registration that does not contradict it
_STRETCH = 8  # consecutive steps over which the drift is measured
_MIN_STRETCHES = 8  # to measure the drift
_UNDERESTIMATED = 1.5  # ratio of measured to stated drift from which it is scaled
_MEDIAN = float(chi_squared(0.5, 3))  # of the squared length of three numbers [squared sigmas]


@dataclass(frozen=True, slots=True)
class Odometry:
    """Dead reckoning at the scans' times.

    Attributes:
        scans: (n,) int, ascending: the scans that it covers.
        T_odom_sensor: n poses, in any frame that does not jump.
        times: (n,) [s], of these scans.
        drift: standard deviation of the translation, as a share of the distance.
        turn_drift: standard deviation of the rotation [rad/s].
        understated: ratio of both to the stated ones, by registrations.
        alone: whether consecutive scans overlap too little to be registered, and only dead reckoning joins them.

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
        """Whether it covers both scans."""
        return bool(np.isin([i, j], self.scans).all())

    def take(self, chosen: Sequence[int]) -> "Odometry":
        """Only these scans, ascending and numbered 0, 1, ..."""
        rows = np.flatnonzero(np.isin(self.scans, chosen))
        scans = np.searchsorted(np.asarray(chosen), self.scans[rows])
        return replace(self, scans=scans, T_odom_sensor=self.T_odom_sensor[rows], times=self.times[rows])

    def scaled(self, factor: float) -> "Odometry":
        """With the drift multiplied by a factor."""
        drifts = {"drift": factor * self.drift, "turn_drift": factor * self.turn_drift}
        return replace(self, **drifts, understated=factor * self.understated)

    def as_registered(self, steps: Sequence[RegisteredPair]) -> "Odometry":
        """With the drift that registrations of consecutive scans show, if it is clearly larger than stated.

        Over stretches of accepted steps, the squared distance between registrations and dead reckoning is that of the
        registrations' covariance plus that of the drift times a squared factor. The median gives the factor, the larger
        one of rotation and translation.
        """
        accepted = {step.i: step for step in steps if step.accepted and self.tells(*step.scans)}
        ratios = []
        for k in accepted:
            if all(k + n in accepted for n in range(_STRETCH)):
                T, covariance = _joined([accepted[k + n] for n in range(_STRETCH)])
                measured, sigmas = self._between(*np.searchsorted(self.scans, [k, k + _STRETCH]).tolist())
                squared: np.ndarray = (T.inv() * measured).as_exp_coords() ** 2
                by_drift = squared.reshape(2, 3).sum(axis=1) / _MEDIAN - np.diag(covariance).reshape(2, 3).mean(axis=1)
                ratios.append(by_drift / sigmas[[0, 3]] ** 2)
        if len(ratios) < _MIN_STRETCHES:
            return self
        squared_factor = float(np.median(ratios, axis=0).max())
        return self.scaled(squared_factor**0.5) if squared_factor >= _UNDERESTIMATED**2 else self

    def expected(self, i: int, j: int, floor: np.ndarray) -> ExpectedPose:
        """The expected T_i_j; its error keeps its direction, and grows with the distance.

        Args:
            i, j: scans that it covers.
            floor: (6,) standard deviations added in quadrature [rad, m].
        """
        T, sigmas = self._between(*np.searchsorted(self.scans, [i, j]).tolist())
        return ExpectedPose.along_target(T, np.hypot(sigmas, floor))

    def contradicts(self, i: int, j: int, T_i_j: RigidTransform, floor: np.ndarray) -> bool:
        """Whether a registration is farther from it than its error and the floor allow."""
        return self.expected(i, j, floor).distance(T_i_j) > _MAX_SIGMAS

    def edges(self, surveys: np.ndarray) -> list[Edge]:
        """Its steps as edges of a graph, within each survey.

        A graph takes errors of edges as independent, but those of dead reckoning add up in one direction. Each step has
        the variance with which all steps together have the error of the whole track.

        Args:
            surveys: (N,) the number of each scan's survey.
        """
        edges = []
        for (a, i), (b, j) in pairwise(enumerate(self.scans.tolist())):
            if surveys[i] != surveys[j]:
                continue
            steps = int((surveys[self.scans] == surveys[i]).sum()) - 1
            T, sigmas = self._between(a, b)
            least = np.repeat([_MIN_TURN_SIGMA, _MIN_SHIFT_SIGMA], 3)
            covariance = np.diag(steps * sigmas**2 + least**2)
            measured = Registration(T, covariance, np.nan, np.nan, accepted=True, seconds=0.0, reason="odometry")
            edges.append(Edge(i, j, measured, "odometry"))
        return edges

    def _between(self, a: int, b: int) -> tuple[RigidTransform, np.ndarray]:
        """T_a_b of two of its poses, and (6,) standard deviations."""
        places = self.T_odom_sensor.translation[a : b + 1]
        way = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
        turn = self.turn_drift * abs(float(self.times[b] - self.times[a]))
        # a steadily growing turn shifts the end by half of the turn times the distance
        sigmas = np.repeat([turn, self.drift * way + turn * way / 2], 3)
        return self.T_odom_sensor[a].inv() * self.T_odom_sensor[b], np.maximum(sigmas, 1e-6)


def _joined(steps: Sequence[RegisteredPair]) -> tuple[RigidTransform, np.ndarray]:
    """The transform from the first step's target to the last one's source, and its covariance, body tangent."""
    reached, covariance = RigidTransform.identity(), np.zeros((6, 6))
    for step in steps:
        assert step.registration is not None
        T_step = step.registration.T_target_source
        reached, covariance = reached * T_step, propagated(T_step.inv(), covariance) + step.registration.covariance
    return reached, covariance
