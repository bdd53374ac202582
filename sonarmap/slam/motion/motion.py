"""The usual motion between consecutive scans, learned from registrations that are sure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.motion.limits import NO_LIMITS, MotionLimits
from sonarmap.slam.motion.local_motion import Step, likeness, rate_of, rates_by_others
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.expected import ExpectedPose

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
# No number of a step varies by less than this share of the variances that are assumed and granted.
_LEAST = 1e-4
# Share of the squared ways of steps that the motion may leave unexplained: of a vehicle that stands half of the time it
# is a half, of scans in no order in 19 of 20 cases 0.74 and more.
_UNEXPLAINED = 0.65
# Steps at least so probable tell how the vehicle moves at a time, also where they leave directions open.
_PROBABLE = 0.5


@dataclass(frozen=True, slots=True)
class Motion:
    """What a vehicle does per unit of time, as numbers x = (rotation vector, translation) in the first scan's axes."""

    times: np.ndarray  # (N,) of the scans, ascending within a survey: seconds where stamps tell them, else scans
    usual: np.ndarray  # (6,) mean of x per unit of time [rad, m]
    covariance: np.ndarray  # (6, 6) of x per unit of time
    # varied, alike: (6,) variance of x per unit of time along the way, and its correlation in steps in a row
    varied: np.ndarray
    alike: np.ndarray
    # rates, variances: (N - 1, 6) mean and variance of x per unit of time from every scan to the next
    rates: np.ndarray
    variances: np.ndarray
    # speed, speed_sigma: mean and standard deviation of the way per unit of time [m]
    speed: float
    speed_sigma: float
    surveys: np.ndarray  # (N,) the number of each scan's survey
    floor: np.ndarray  # (6,) standard deviations that every expectation is granted beside [rad, m]
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
        """From accepted registrations of consecutive scans; by the limits, or None without, from fewer than FEWEST, and
        where the steps have little in common.

        A multivariate t with 4 degrees of freedom is fitted by expectation and maximization (Lange, Little and Taylor,
        DOI 10.2307/2290063); mean and covariance are then those of the steps that this does not exclude, so that rare
        turns count in full and a few wrong registrations do not count at all. Where fewer than FEWEST are accepted,
        those count, too, that have found the place but leave directions open, for what they hold; then those that have
        probably found it.

        Args:
            pairs: of the survey, registered.
            stamps: (N,) [s] of the scans.
            surveys: (N,) the number of each scan's survey.
            floor, limits: as the attributes.
        """
        times = scan_times(stamps, surveys)
        telling = _telling(pairs, times, limits)
        if len(telling) >= FEWEST:
            steps = _UsualSteps.of(telling, times, floor)
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
        known = len(rates) / (len(rates) + _ASSUMED)
        assumed = (1 - known) * np.maximum(_assumed(rates), np.repeat([_TURNS / span, 0.0], 3) ** 2)
        scatter = known * (np.cov(rates.T, bias=True) + steps.left.mean(axis=0))
        varied = np.maximum(np.diag(scatter), _LEAST * (assumed + (floor / span) ** 2))
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
        """Whether (n, 6) rates of steps from these scans are much nearer to what the others say than to rest.

        Scans in no order, or of a vehicle that goes to and fro, have steps in all directions.
        """
        count, away = len(rates), (rates - self.rates[steps])[:, 3:]
        floor = self.floor[3:] / np.median(np.diff(self.times))
        squared = (rates[:, 3:] ** 2).sum() + count * (floor**2).sum()
        return bool((away**2).sum() * count / (count - 1) <= _UNEXPLAINED * squared)

    @classmethod
    def _unlearned(cls, times: np.ndarray, surveys: np.ndarray, floor: np.ndarray, limits: MotionLimits) -> "Motion":
        """By the limits alone."""
        rates, anything = np.zeros((len(times) - 1, 6)), np.full(6, _ANYTHING**2)
        return cls(
            times=times,
            usual=np.zeros(6),
            covariance=np.diag(anything),
            varied=anything,
            alike=np.zeros(6),
            rates=rates,
            variances=rates + anything,
            speed=0.0,
            speed_sigma=_ANYTHING,
            surveys=surveys,
            floor=floor,
            limits=limits,
        )

    def following(self, pairs: Sequence[RegisteredPair]) -> "Motion":
        """With the rates that registered steps tell, all that are probable; of each as the others tell."""
        steps = [Step.of(pair, self.times) for pair in pairs if self._tells(pair)]
        rates, variances = rates_by_others(steps, self.usual, self.varied, self.alike, self.times, self.surveys)
        return replace(self, rates=rates, variances=variances + np.diag(self.covariance) - self.varied)

    def _tells(self, pair: RegisteredPair) -> bool:
        registration = pair.registration
        if pair.role != "sequential" or registration is None:
            return False
        return _is_probable(pair) and not self.contradicts(*pair.scans, registration.T_target_source)

    def expected(self, i: int, j: int) -> ExpectedPose:
        """T_i_j: its mean is that of a steady motion, its spread grows with the time between, up to the limits."""
        span = float(self.times[j] - self.times[i])
        shares = np.diff(self.times[i : j + 1]) / span
        T = _steady(shares @ self.rates[i:j], span)
        spread = np.sqrt(_GRANTED * (shares @ self.variances[i:j])) * span
        most = np.repeat([self.limits.turn(span), self.limits.way(span, j - i)], 3) / _LIMIT_SIGMAS
        return ExpectedPose.along_target(T, np.hypot(np.minimum(spread, most), self.floor))

    def way(self, i: int, j: int) -> tuple[float, float]:
        """Mean and standard deviation of the way from i to j [m].

        Vehicles drift aside, and look where they do not go: how far they go varies less than where to.
        """
        span = float(self.times[j] - self.times[i])
        return self.speed * span, float(np.hypot(np.sqrt(_GRANTED) * self.speed_sigma * span, self.floor[3:].max()))

    def contradicts(self, i: int, j: int, T_i_j: RigidTransform) -> bool:
        """Whether a step is farther from the usual motion than one of 100, or beyond the limits."""
        return self.is_beyond(i, j, T_i_j) or self._distance(i, j, T_i_j) > _BEYOND

    def unlikelihood(self, i: int, j: int, T_i_j: RigidTransform) -> float:
        """The negative logarithm of the density of a step under Student's t, up to a constant."""
        return (_TAILS + 6) / 2 * float(np.log1p(self._distance(i, j, T_i_j) / _TAILS))

    def _distance(self, i: int, j: int, T_i_j: RigidTransform) -> float:
        """Squared Mahalanobis distance of a step from the usual motion, over the scatter of Student's t."""
        span = float(self.times[j] - self.times[i])
        scatter = self.covariance * span**2 * (_TAILS - 2) / _TAILS + np.diag(self.floor**2)
        return float(_squared(rate_of(T_i_j)[None] - self.usual * span, scatter)[0])

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
    stamped = np.isfinite(stamps).all() and (np.diff(stamps)[same] > 0).all()
    return stamps.astype(np.float64) if stamped else np.arange(len(stamps), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class _UsualSteps:
    """The n steps that a fit of the usual motion does not exclude."""

    steps: Sequence[Step]
    rates: np.ndarray  # (n, 6) per unit of time [rad, m]
    left: np.ndarray  # (n, 6, 6) covariances of what the registrations leave open of the rates
    span: float  # median time between two scans, in units of time

    @classmethod
    def of(cls, pairs: Sequence[RegisteredPair], times: np.ndarray, floor: np.ndarray) -> "_UsualSteps":
        """Of registered steps of a survey whose scans have these `times` (N,)."""
        steps = [Step.of(pair, times) for pair in pairs]
        spans = np.array([times[pair.j] - times[pair.i] for pair in pairs])
        span = float(np.median(spans))
        measured, errors = np.array([step.rate for step in steps]), _errors(steps, pairs, spans / span)
        mean, scatter = _fit_t(measured, errors, floor / span)
        rates, left = _filled(measured, errors, mean, scatter)
        within = np.flatnonzero(_squared(rates - mean, scatter) <= _BEYOND)
        return cls([steps[n] for n in within], rates[within], left[within], span)


def _telling(pairs: Sequence[RegisteredPair], times: np.ndarray, limits: MotionLimits) -> list[RegisteredPair]:
    """Consecutive pairs from which the motion is learned: accepted ones; if they are too few, also probable ones."""
    possible = [pair for pair in pairs if pair.role == "sequential" and pair.registration is not None]
    possible = [pair for pair in possible if _within(limits, times, pair)]
    steps: list[RegisteredPair] = []
    for believed in (_is_accepted, _is_placed, _is_probable):
        if len(steps) < FEWEST:
            steps = [pair for pair in possible if believed(pair)]
    return steps


def _is_accepted(pair: RegisteredPair) -> bool:
    return pair.accepted


def _is_placed(pair: RegisteredPair) -> bool:
    return pair.accepted or pair.placed


def _is_probable(pair: RegisteredPair) -> bool:
    return pair.accepted or (pair.registration is not None and pair.registration.probability >= _PROBABLE)


def _within(limits: MotionLimits, times: np.ndarray, pair: RegisteredPair) -> bool:
    """Whether a registered step is within the limits."""
    assert pair.registration is not None
    span, T = float(times[pair.j] - times[pair.i]), pair.registration.T_target_source
    way, turn = np.linalg.norm(T.translation), T.rotation.magnitude()
    return bool(way <= limits.way(span, pair.j - pair.i) and turn <= limits.turn(span))


def _errors(sure: Sequence[Step], steps: Sequence[RegisteredPair], spans: np.ndarray) -> np.ndarray:
    """(n, 6, 6) covariances of rates, of steps that take so many times (n,) as long as usual.

    What is accepted is taken as it is; but where a step is shorter, its error is a larger part of it.
    """
    errors, accepted = np.array([step.covariance for step in sure]), np.array([pair.accepted for pair in steps])
    errors[accepted] *= np.maximum(1 - spans[accepted, None, None] ** 2, 0.0)
    return errors


def _steady(usual: np.ndarray, span: float) -> RigidTransform:
    """Where a motion of these rates leads."""
    turn, shift = usual[:3] * span, usual[3:] * span
    return RigidTransform.from_components(shift, Rotation.from_rotvec(turn))


def _assumed(rates: np.ndarray) -> np.ndarray:
    """(6,) variances before any is known: of a vehicle that moves and turns anywhere, as far as it does."""
    turn, shift = np.median((rates**2).reshape(len(rates), 2, 3).sum(axis=2), axis=0) / 3
    return np.repeat([turn, shift], 3)


def _fit_t(rates: np.ndarray, errors: np.ndarray, floor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Location (6,) and scatter (6, 6) of a multivariate t, drawn toward what is assumed.

    Args:
        rates: (n, 6) of steps.
        errors: (n, 6, 6) the covariances of their errors.
        floor: (6,) standard deviations that are granted.
    """
    count, size = rates.shape
    least = np.diag(_assumed(rates) + floor**2)
    mean, scatter = np.median(rates, axis=0), least
    for _ in range(_ITERATIONS):
        full, left = _filled(rates, errors, mean, scatter)
        weight = (_TAILS + size) / (_TAILS + _squared(full - mean, scatter))
        mean = weight @ full / weight.sum()
        away = full - mean
        scatter = ((weight[:, None] * away).T @ away + left.sum(axis=0) + _ASSUMED * least) / (count + _ASSUMED)
    return mean, scatter


def _filled(
    rates: np.ndarray, errors: np.ndarray, mean: np.ndarray, scatter: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 6) the rates as expected where they leave directions open, and (n, 6, 6) what remains unknown of them."""
    gain = scatter @ np.linalg.inv(scatter + errors)
    return mean + np.einsum("nab,nb->na", gain, rates - mean), scatter - gain @ scatter


def _squared(away: np.ndarray, scatter: np.ndarray) -> np.ndarray:
    """(m,) squared Mahalanobis lengths of (m, 6)."""
    return np.einsum("na,na->n", away, np.linalg.solve(scatter, away.T).T)
