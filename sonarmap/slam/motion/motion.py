"""The usual motion between consecutive scans, learned from accepted registrations."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.motion.limits import NO_LIMITS, MotionLimits
from sonarmap.slam.motion.local_motion import Step, likeness, rate_of, rates_by_others
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.expected import ExpectedPose

FEWEST = 4  # steps from which a motion can be learned
_TAILS = 4.0  # degrees of freedom of Student's t: some vehicles turn rarely, and then a lot
_PRIOR = 4.0  # weight of the assumed spread [steps]
_PRIOR_TURN = float(np.radians(20.0))  # least assumed sigma of turns [rad]: vehicles turn at the end of every lane
_ITERATIONS = 50
_SPEED_SIGMAS = 6.0  # above the usual speed, which a vehicle never exceeds
_LIMIT_SIGMAS = 3.0  # least number of sigmas of an expected motion within a limit
_UNKNOWN_SIGMA = 1e3  # of a motion of which only limits are known [rad, m]
_MAX_SQUARED = 6 * 15.21  # squared distance of six numbers that 1 of 100 steps exceeds under this t: 6 F(6, 4)
_WIDENED = 2.0  # of an expected motion over the learned one: vehicles turn, stop and go
_MIN_VARIANCE = 1e-4  # of a number of a step, as a share of the assumed and added variances
_MAX_UNEXPLAINED = 0.65  # share of the squared translations; a half for a vehicle that stands half of the time
_MIN_PROBABILITY = 0.5  # of a step that shows the local motion, also with unconstrained directions


@dataclass(frozen=True, slots=True)
class Motion:
    """A vehicle's motion per unit of time, as x = (rotation vector, translation) in the first scan's axes."""

    times: np.ndarray  # (N,) of the scans, ascending within a survey: stamps [s] if they ascend, else numbers
    usual: np.ndarray  # (6,) mean of x [rad, m]
    covariance: np.ndarray  # (6, 6) of x
    # varied, alike: (6,) variance of x along the track, and its correlation between consecutive steps
    varied: np.ndarray
    alike: np.ndarray
    # rates, variances: (N - 1, 6) mean and variance of x from every scan to the next
    rates: np.ndarray
    variances: np.ndarray
    # speed, speed_sigma: mean and standard deviation of the distance per unit of time [m]
    speed: float
    speed_sigma: float
    surveys: np.ndarray  # (N,) the number of each scan's survey
    floor: np.ndarray  # (6,) standard deviations added to those of every expected pose [rad, m]
    limits: MotionLimits = NO_LIMITS  # what the vehicle cannot exceed

    @classmethod
    def learn(
        cls,
        pairs: Sequence[RegisteredPair],
        stamps: np.ndarray,
        surveys: np.ndarray,
        floor: np.ndarray,
        limits: MotionLimits = NO_LIMITS,
    ) -> "Motion | None":
        """From accepted registrations of consecutive scans. With fewer than FEWEST, or with steps that have little in
        common, only the limits count, and without limits there is no motion.

        A multivariate t with 4 degrees of freedom is fitted by expectation and maximization (Lange, Little and Taylor,
        DOI 10.2307/2290063). Mean and covariance are then those of the steps that the fit does not exclude: rare turns
        count in full, a few wrong registrations not at all. If fewer than FEWEST are accepted, those with an accepted
        place and unconstrained directions count too, then probable ones.

        Args:
            pairs: of the survey, registered.
            stamps: (N,) [s] of the scans.
            surveys: (N,) the number of each scan's survey.
            floor, limits: as the attributes.
        """
        times = scan_times(stamps, surveys)
        chosen = _steps_to_learn(pairs, times, limits)
        if len(chosen) >= FEWEST:
            steps = _UsualSteps.of(chosen, times, floor)
            motion = cls._learned(steps, times, surveys, floor, limits).following(pairs)
            if motion._explains(steps.rates, [step.k for step in steps.steps]):
                return motion
        return cls._unlearned(times, surveys, floor, limits) if limits.any else None

    @classmethod
    def _learned(
        cls, steps: "_UsualSteps", times: np.ndarray, surveys: np.ndarray, floor: np.ndarray, limits: MotionLimits
    ) -> "Motion":
        """The mean and covariance of the steps, drawn toward those of any vehicle if there are few."""
        rates, span = steps.rates, steps.span
        mean, speeds = rates.mean(axis=0), np.linalg.norm(rates[:, 3:], axis=1)
        known = len(rates) / (len(rates) + _PRIOR)
        assumed = (1 - known) * np.maximum(_assumed(rates), np.repeat([_PRIOR_TURN / span, 0.0], 3) ** 2)
        scatter = known * (np.cov(rates.T, bias=True) + steps.unknown.mean(axis=0))
        varied = np.maximum(np.diag(scatter), _MIN_VARIANCE * (assumed + (floor / span) ** 2))
        return cls(
            times=times,
            usual=mean,
            covariance=scatter + np.diag(varied - np.diag(scatter) + assumed),
            varied=varied,
            alike=likeness(steps.steps, varied, surveys),
            rates=np.tile(mean, (len(times) - 1, 1)),
            variances=np.tile(varied + assumed, (len(times) - 1, 1)),
            speed=float(speeds.mean()),
            speed_sigma=float(np.sqrt(known * speeds.var() + assumed[3:].mean())),
            surveys=surveys,
            floor=floor,
            limits=limits,
        )

    def _explains(self, rates: np.ndarray, steps: Sequence[int]) -> bool:
        """Whether (n, 6) rates of steps from these scans are much closer to their predictions than to rest.

        Scans in no order, or of a vehicle that goes to and fro, have steps in all directions.
        """
        count, away = len(rates), (rates - self.rates[steps])[:, 3:]
        floor = self.floor[3:] / np.median(np.diff(self.times))
        squared = (rates[:, 3:] ** 2).sum() + count * (floor**2).sum()
        return bool((away**2).sum() * count / (count - 1) <= _MAX_UNEXPLAINED * squared)

    @classmethod
    def _unlearned(cls, times: np.ndarray, surveys: np.ndarray, floor: np.ndarray, limits: MotionLimits) -> "Motion":
        """By the limits alone."""
        rates, unknown = np.zeros((len(times) - 1, 6)), np.full(6, _UNKNOWN_SIGMA**2)
        return cls(
            times=times,
            usual=np.zeros(6),
            covariance=np.diag(unknown),
            varied=unknown,
            alike=np.zeros(6),
            rates=rates,
            variances=rates + unknown,
            speed=0.0,
            speed_sigma=_UNKNOWN_SIGMA,
            surveys=surveys,
            floor=floor,
            limits=limits,
        )

    def following(self, pairs: Sequence[RegisteredPair]) -> "Motion":
        """With rates by all probable registered steps; each is predicted from the others."""
        steps = [Step.of(pair, self.times) for pair in pairs if self._shows_motion(pair)]
        rates, variances = rates_by_others(steps, self.usual, self.varied, self.alike, self.times, self.surveys)
        return replace(self, rates=rates, variances=variances + np.diag(self.covariance) - self.varied)

    def _shows_motion(self, pair: RegisteredPair) -> bool:
        registration = pair.registration
        if pair.role != "sequential" or registration is None:
            return False
        return _is_probable(pair) and not self.contradicts(*pair.scans, registration.T_target_source)

    def expected(self, i: int, j: int) -> ExpectedPose:
        """The expected T_i_j, by a steady motion; its spread grows with the time between, up to the limits."""
        span = float(self.times[j] - self.times[i])
        shares = np.diff(self.times[i : j + 1]) / span
        T = _steady(shares @ self.rates[i:j], span)
        spread = np.sqrt(_WIDENED * (shares @ self.variances[i:j])) * span
        most = np.repeat([self.limits.turn(span), self.limits.way(span, j - i)], 3) / _LIMIT_SIGMAS
        return ExpectedPose.along_target(T, np.hypot(np.minimum(spread, most), self.floor))

    def way(self, i: int, j: int) -> tuple[float, float]:
        """Mean and standard deviation of the distance from i to j [m].

        It varies less than the direction, as vehicles drift sideways and need not face their motion.
        """
        span = float(self.times[j] - self.times[i])
        return self.speed * span, float(np.hypot(np.sqrt(_WIDENED) * self.speed_sigma * span, self.floor[3:].max()))

    def contradicts(self, i: int, j: int, T_i_j: RigidTransform) -> bool:
        """Whether a step is farther from the usual motion than 99 of 100, or out of reach."""
        return self.is_beyond(i, j, T_i_j) or self._distance(i, j, T_i_j) > _MAX_SQUARED

    def unlikelihood(self, i: int, j: int, T_i_j: RigidTransform) -> float:
        """The negative logarithm of the density of a step under Student's t, up to a constant."""
        return (_TAILS + 6) / 2 * float(np.log1p(self._distance(i, j, T_i_j) / _TAILS))

    def _distance(self, i: int, j: int, T_i_j: RigidTransform) -> float:
        """Squared Mahalanobis distance of a step from the usual motion, over the scatter of Student's t."""
        span = float(self.times[j] - self.times[i])
        scatter = self.covariance * span**2 * (_TAILS - 2) / _TAILS + np.diag(self.floor**2)
        return float(_squared(rate_of(T_i_j)[None] - self.usual * span, scatter)[0])

    def is_measured(self, i: int, j: int) -> bool:
        """False: the motion is learned."""
        return False

    def is_beyond(self, i: int, j: int, T_i_j: RigidTransform) -> bool:
        """Whether scan j of one survey is out of reach from scan i, by the limits or by a multiple of the usual
        spread of speeds."""
        span = float(self.times[j] - self.times[i])
        usual, spread = np.linalg.norm(self.usual[3:]), np.sqrt(np.trace(self.covariance[3:, 3:]))
        way = min(self.limits.way(span, j - i), span * float(usual + _SPEED_SIGMAS * spread)) + 3 * self.floor[3:].max()
        turn = self.limits.turn(span) + 3 * self.floor[:3].max()
        return bool(np.linalg.norm(T_i_j.translation) > way or T_i_j.rotation.magnitude() > turn)


def scan_times(stamps: np.ndarray, surveys: np.ndarray) -> np.ndarray:
    """(N,) times that ascend within each survey: the stamps, or the scans' numbers if the stamps do not ascend."""
    same = np.diff(surveys) == 0
    stamped = np.isfinite(stamps).all() and (np.diff(stamps)[same] > 0).all()
    return stamps.astype(np.float64) if stamped else np.arange(len(stamps), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class _UsualSteps:
    """The n steps that a fit of the usual motion does not exclude."""

    steps: Sequence[Step]
    rates: np.ndarray  # (n, 6) per unit of time [rad, m]
    unknown: np.ndarray  # (n, 6, 6) remaining covariances of the rates
    span: float  # median time between two scans, in units of time

    @classmethod
    def of(cls, pairs: Sequence[RegisteredPair], times: np.ndarray, floor: np.ndarray) -> "_UsualSteps":
        """Of registered steps; `times` (N,) are those of the scans."""
        steps = [Step.of(pair, times) for pair in pairs]
        spans = np.array([times[pair.j] - times[pair.i] for pair in pairs])
        span = float(np.median(spans))
        measured, errors = np.array([step.rate for step in steps]), _errors(steps, pairs, spans / span)
        mean, scatter = _fit_t(measured, errors, floor / span)
        rates, unknown = _filled(measured, errors, mean, scatter)
        within = np.flatnonzero(_squared(rates - mean, scatter) <= _MAX_SQUARED)
        return cls([steps[n] for n in within], rates[within], unknown[within], span)


def _steps_to_learn(pairs: Sequence[RegisteredPair], times: np.ndarray, limits: MotionLimits) -> list[RegisteredPair]:
    """Consecutive pairs to learn from: accepted ones; if these are too few, also placed, then probable ones."""
    possible = [pair for pair in pairs if pair.role == "sequential" and pair.registration is not None]
    possible = [pair for pair in possible if _within(limits, times, pair)]
    steps: list[RegisteredPair] = []
    for is_usable in (_is_accepted, _is_placed, _is_probable):
        if len(steps) < FEWEST:
            steps = [pair for pair in possible if is_usable(pair)]
    return steps


def _is_accepted(pair: RegisteredPair) -> bool:
    return pair.accepted


def _is_placed(pair: RegisteredPair) -> bool:
    return pair.accepted or pair.placed


def _is_probable(pair: RegisteredPair) -> bool:
    return pair.accepted or (pair.registration is not None and pair.registration.probability >= _MIN_PROBABILITY)


def _within(limits: MotionLimits, times: np.ndarray, pair: RegisteredPair) -> bool:
    """Whether a registered step is within the limits."""
    assert pair.registration is not None
    span, T = float(times[pair.j] - times[pair.i]), pair.registration.T_target_source
    way, turn = np.linalg.norm(T.translation), T.rotation.magnitude()
    return bool(way <= limits.way(span, pair.j - pair.i) and turn <= limits.turn(span))


def _errors(sure: Sequence[Step], steps: Sequence[RegisteredPair], spans: np.ndarray) -> np.ndarray:
    """(n, 6, 6) covariances of rates; `spans` (n,) are the durations of steps [usual durations].

    Accepted steps count as exact, except shorter ones, of which the error is a larger part.
    """
    errors, accepted = np.array([step.covariance for step in sure]), np.array([pair.accepted for pair in steps])
    errors[accepted] *= np.maximum(1 - spans[accepted, None, None] ** 2, 0.0)
    return errors


def _steady(usual: np.ndarray, span: float) -> RigidTransform:
    """The transform by a steady motion of these rates."""
    turn, shift = usual[:3] * span, usual[3:] * span
    return RigidTransform.from_components(shift, Rotation.from_rotvec(turn))


def _assumed(rates: np.ndarray) -> np.ndarray:
    """(6,) assumed variances: of a vehicle that moves and turns in any direction, as far as it does."""
    turn, shift = np.median((rates**2).reshape(len(rates), 2, 3).sum(axis=2), axis=0) / 3
    return np.repeat([turn, shift], 3)


def _fit_t(rates: np.ndarray, errors: np.ndarray, floor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Location (6,) and scatter (6, 6) of a multivariate t, drawn toward the assumed scatter.

    Args:
        rates: (n, 6) of steps.
        errors: (n, 6, 6) the covariances of their errors.
        floor: (6,) standard deviations added to the assumed ones.
    """
    count, size = rates.shape
    least = np.diag(_assumed(rates) + floor**2)
    mean, scatter = np.median(rates, axis=0), least
    for _ in range(_ITERATIONS):
        full, unknown = _filled(rates, errors, mean, scatter)
        weight = (_TAILS + size) / (_TAILS + _squared(full - mean, scatter))
        mean = weight @ full / weight.sum()
        away = full - mean
        scatter = ((weight[:, None] * away).T @ away + unknown.sum(axis=0) + _PRIOR * least) / (count + _PRIOR)
    return mean, scatter


def _filled(
    rates: np.ndarray, errors: np.ndarray, mean: np.ndarray, scatter: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 6) rates with expected values in unconstrained directions, and (n, 6, 6) their remaining covariances."""
    gain = scatter @ np.linalg.inv(scatter + errors)
    return mean + np.einsum("nab,nb->na", gain, rates - mean), scatter - gain @ scatter


def _squared(away: np.ndarray, scatter: np.ndarray) -> np.ndarray:
    """(m,) squared Mahalanobis lengths of (m, 6) deviations."""
    return np.einsum("na,na->n", away, np.linalg.solve(scatter, away.T).T)
