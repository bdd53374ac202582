# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""The usual motion between consecutive scans, learned from registrations that are sure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from slam.motion.limits import NO_LIMITS, MotionLimits
from slam.pair import Pair
from spectral.expected import ExpectedPose

# Steps from which a motion can be learned.
FEWEST = 4
# Degrees of freedom of Student's t: some vehicles turn rarely, and then a lot.
_TAILS = 4.0
# The spread that is assumed before steps are seen counts like so many of them; its turns are at least so large [rad]:
# vehicles turn at the end of every lane.
_ASSUMED, _TURNS = 4.0, float(np.radians(20.0))
_ITERATIONS = 50
# A vehicle is never faster than it usually is by more than so many standard deviations.
_FASTEST = 6.0
# A limit is so many standard deviations of what is expected within it.
_LIMIT_SIGMAS = 3.0
# The spread where only limits are known [rad, m]: they decide.
_ANYTHING = 1e3
# Squared distance of six numbers over their scatter that one step of 100 exceeds, under this t: 6 F(6, 4).
_BEYOND = 6 * 15.21
# Steps of vehicles that turn, stop and go leave what was seen so far: the spread that is granted, of the learned one.
_GRANTED = 2.0


@dataclass(frozen=True, slots=True)
class Motion:
    """What a vehicle does per unit of time, as numbers x = (rotation vector, translation) in the first scan's axes.

    Attributes:
        times: (N,) of the scans, ascending within a survey: seconds where stamps tell them, else scans.
        usual: (6,) mean of x per unit of time [rad, m].
        covariance: (6, 6) of x per unit of time.
        floor: (6,) standard deviations that every expectation is granted beside [rad, m].
        limits: what the vehicle cannot exceed.
    """

    times: np.ndarray
    usual: np.ndarray
    covariance: np.ndarray
    floor: np.ndarray
    limits: MotionLimits = NO_LIMITS

    @classmethod
    def learn(
        cls,
        pairs: Sequence[Pair],
        stamps: np.ndarray,
        surveys: np.ndarray,
        floor: np.ndarray,
        limits: MotionLimits = NO_LIMITS,
    ) -> "Motion | None":
        """From accepted registrations of consecutive scans; from fewer than FEWEST, by the limits, or None without.

        A multivariate t with 4 degrees of freedom is fitted by expectation and maximization (Lange, Little and Taylor,
        DOI 10.2307/2290063); mean and covariance are then those of the steps that this does not exclude, so that rare
        turns count in full and a few wrong registrations do not count at all.

        Args:
            pairs: of the survey, registered.
            stamps: (N,) [s] of the scans.
            surveys: (N,) the number of each scan's survey.
            floor, limits: as the attributes.
        """
        times = scan_times(stamps, surveys)
        steps = [pair for pair in pairs if pair.role == "sequential" and pair.accepted]
        steps = [pair for pair in steps if _within(limits, times, pair)]
        if len(steps) < FEWEST:
            if not limits.any:
                return None
            return cls(times, np.zeros(6), np.diag(np.full(6, _ANYTHING**2)), floor, limits)
        T = RigidTransform.concatenate([pair.registration.T_target_source for pair in steps if pair.registration])
        spans = times[[pair.j for pair in steps]] - times[[pair.i for pair in steps]]
        rates = np.hstack([T.rotation.as_rotvec(), T.translation]) / spans[:, None]
        span = float(np.median(spans))
        mean, scatter = _fit_t(rates, floor / span)
        rates = rates[_squared(rates - mean, scatter) <= _BEYOND]
        mean = rates.mean(axis=0)
        assumed = np.diag(np.maximum(_assumed(rates), np.repeat([_TURNS / span, 0.0], 3) ** 2))
        covariance = (len(rates) * np.cov(rates.T, bias=True) + _ASSUMED * assumed) / (len(rates) + _ASSUMED)
        return cls(times, mean, covariance, floor, limits)

    def expected(self, i: int, j: int) -> ExpectedPose:
        """T_i_j: its mean is that of a steady motion, its spread grows with the time between, up to the limits."""
        span = float(self.times[j] - self.times[i])
        T = _steady(self.usual, span)
        spread = np.sqrt(_GRANTED * np.diag(self.covariance)) * span
        most = np.repeat([self.limits.turn(span), self.limits.way(span, j - i)], 3) / _LIMIT_SIGMAS
        sigmas = np.hypot(np.minimum(spread, most), self.floor)
        return ExpectedPose.of(T, sigmas)

    def contradicts(self, i: int, j: int, T_i_j: RigidTransform) -> bool:
        """Whether a step is farther from the usual motion than one of 100, or beyond the limits."""
        if self.is_beyond(i, j, T_i_j):
            return True
        span = float(self.times[j] - self.times[i])
        x = np.concatenate([T_i_j.rotation.as_rotvec(), T_i_j.translation])
        scatter = self.covariance * span**2 * (_TAILS - 2) / _TAILS + np.diag(self.floor**2)
        return bool(_squared(x[None] - self.usual * span, scatter)[0] > _BEYOND)

    def is_measured(self, i: int, j: int) -> bool:
        """Never: it is learned."""
        return False

    def is_beyond(self, i: int, j: int, T_i_j: RigidTransform) -> bool:
        """Whether the vehicle cannot have got from scan i to scan j of one survey: by the limits, or many times faster
        than it usually is."""
        span = float(self.times[j] - self.times[i])
        usual, spread = np.linalg.norm(self.usual[3:]), np.sqrt(np.trace(self.covariance[3:, 3:]))
        way = min(self.limits.way(span, j - i), span * float(usual + _FASTEST * spread)) + 3 * self.floor[3:].max()
        turn = self.limits.turn(span) + 3 * self.floor[:3].max()
        return bool(np.linalg.norm(T_i_j.translation) > way or T_i_j.rotation.magnitude() > turn)


def scan_times(stamps: np.ndarray, surveys: np.ndarray) -> np.ndarray:
    """(N,) ascending within each survey: the stamps, or where they do not tell times the scans' numbers."""
    same = np.diff(surveys) == 0
    told = np.isfinite(stamps).all() and (np.diff(stamps)[same] > 0).all()
    return stamps.astype(np.float64) if told else np.arange(len(stamps), dtype=np.float64)


def _within(limits: MotionLimits, times: np.ndarray, pair: Pair) -> bool:
    """Whether a registered step is within the limits."""
    assert pair.registration is not None
    span, T = float(times[pair.j] - times[pair.i]), pair.registration.T_target_source
    way, turn = np.linalg.norm(T.translation), T.rotation.magnitude()
    return bool(way <= limits.way(span, pair.j - pair.i) and turn <= limits.turn(span))


def _steady(usual: np.ndarray, span: float) -> RigidTransform:
    """Where a motion of these rates leads."""
    turn, shift = usual[:3] * span, usual[3:] * span
    return RigidTransform.from_components(shift, Rotation.from_rotvec(turn))


def _assumed(rates: np.ndarray) -> np.ndarray:
    """(6,) variances before any is known: of a vehicle that moves and turns anywhere, as far as it does."""
    turn, shift = np.median((rates**2).reshape(len(rates), 2, 3).sum(axis=2), axis=0) / 3
    return np.repeat([turn, shift], 3)


def _fit_t(rates: np.ndarray, floor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Location (6,) and scatter (6, 6) of a multivariate t, drawn toward what is assumed."""
    count, size = rates.shape
    least = np.diag(_assumed(rates) + floor**2)
    mean, scatter = np.median(rates, axis=0), least
    for _ in range(_ITERATIONS):
        away = rates - mean
        weight = (_TAILS + size) / (_TAILS + _squared(away, scatter))
        mean = weight @ rates / weight.sum()
        away = rates - mean
        scatter = ((weight[:, None] * away).T @ away + _ASSUMED * least) / (count + _ASSUMED)
    return mean, scatter


def _squared(away: np.ndarray, scatter: np.ndarray) -> np.ndarray:
    """(m,) squared Mahalanobis lengths of (m, 6)."""
    return np.einsum("na,na->n", away, np.linalg.solve(scatter, away.T).T)
