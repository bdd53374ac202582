"""What the motion adds to registrations: a second look about where it expects them, and a measurement beside them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.motion.measured_motion import AnyMotion
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.geometry import rotated
from sonarmap.spectral.result import Registration

# Poses are less sure than the marginals of an estimate say: the variance over theirs (`slam.graph.pose_covariance`).
_UNSURE = 3.0
# What is left of an answer's probability where the motion contradicts it: vehicles do jump now and then.
_CONTRADICTED = 0.1
# How far a vehicle goes holds a direction where it is at least so many standard deviations; nearly at rest it has none.
_UNDER_WAY = 2.0
# The direction of the way is taken anew so often.
_ROUNDS = 5

# The odds that consecutive scans share a place, over those of any pair. Of 982 pairs without overlap at most 2 are then
# accepted, and of 1,459 right steps over rich relief 4 refused; with 4.0, one step joined 5 of 35 pairs of dives.
_STEP_ODDS = 2.5


def is_doubtful(pair: RegisteredPair, motion: AnyMotion) -> bool:
    """Whether a pair is worth another look: it was not accepted, the motion contradicts what was, or with the motion
    another of its answers is more probable."""
    registration = pair.registration
    if registration is None:
        return False
    if not registration.accepted or motion.contradicts(*pair.scans, registration.T_target_source):
        return True
    first, *others = (
        each.probability * exp(-motion.unlikelihood(*pair.scans, each.T_target_source))
        for each in (registration, *registration.alternatives)
    )
    return max(others, default=0.0) > first


def with_both(first: RegisteredPair, second: RegisteredPair, motion: AnyMotion | None = None) -> RegisteredPair:
    """A pair that was registered by the scans alone with its second registration, about where it is expected, and the
    first one's answers beside it: less probable where the motion contradicts them.

    What was looked for about an estimate, where no motion is given, is found there, rightly or not: it is as sure as
    that window where it is wrong. A step about the usual motion is weighed by that later, in `with_motion`.
    """
    if first.registration is None or second.registration is None:
        return first
    answer = second.registration
    left = 1.0 - answer.probability
    beside = left - sum(other.probability for other in answer.alternatives)
    answers = (first.registration, *first.registration.alternatives)
    earlier = tuple(_less(each, beside, first, motion) for each in answers)
    if motion is None and second.expected is not None:
        away, window = _window(answer, second.expected)
        answer = replace(answer, covariance=answer.covariance + left * (window + np.outer(away, away)))
    return replace(second, registration=replace(answer, alternatives=(*answer.alternatives, *earlier)))


def without_leaps(pair: RegisteredPair, motion: AnyMotion) -> RegisteredPair:
    """The pair of one survey without answers that the vehicle cannot have reached meanwhile."""
    registration = pair.registration
    if registration is None:
        return pair

    def reached(answer: Registration) -> bool:
        return not motion.is_beyond(*pair.scans, answer.T_target_source)

    alternatives = tuple(answer for answer in registration.alternatives if reached(answer))
    if not reached(registration):
        reason = f"the vehicle cannot have come so far in the time between; {registration.reason}"
        registration = replace(registration, accepted=False, probability=0.0, reason=reason)
    return replace(pair, registration=replace(registration, alternatives=alternatives))


def expected_by(solution: Solution, pairs: Sequence[RegisteredPair], floor: np.ndarray) -> list[ExpectedPose]:
    """Where an estimate of the poses expects pairs of one component each; `floor` is (6,) granted beside [rad, m]."""
    T, covariances = solution.relatives(np.array([pair.scans for pair in pairs], np.intp).reshape(-1, 2))
    wider = _UNSURE * covariances + np.diag(floor**2)
    return [ExpectedPose.of(T_i_j, covariance) for T_i_j, covariance in zip(T, wider, strict=True)]


def believing_steps(pairs: Sequence[RegisteredPair], motion: AnyMotion | None) -> list[RegisteredPair]:
    """The pairs, those of consecutive scans believed as far as they are likely: these nearly always share a place.

    What is likely is accepted; where the scans leave its pose open, as wide as the usual motion leaves it.
    """
    return [_as_step(pair, motion) if pair.role == "sequential" and not pair.accepted else pair for pair in pairs]


def _as_step(pair: RegisteredPair, motion: AnyMotion | None) -> RegisteredPair:
    registration = pair.registration
    if registration is None or not registration.probability > 0:
        return pair
    odds = _STEP_ODDS * registration.probability
    as_step = registration.with_probability(odds / (odds + 1 - registration.probability))
    if not as_step.placed:
        return pair
    usual = None if motion is None or motion.is_measured(*pair.scans) else motion
    why, evidence = "likely enough for a step between consecutive scans", (("likely", registration.probability),)
    if registration.placed:
        why, evidence = "the usual motion holds what the scans leave open", ()
    if not registration.is_fixed:
        if usual is None:
            return pair
        as_step = _either(as_step, usual.expected(*pair.scans), registration.probability)
    evidence = (*registration.evidence, *evidence)
    accepted = replace(as_step, accepted=True, reason=f"{why}; {registration.reason}", evidence=evidence)
    return replace(pair, registration=accepted)


def _either(registration: Registration, expected: ExpectedPose, share: float) -> Registration:
    """Mean and covariance of either the registration, which has this share, or what is expected."""
    away, window = _window(registration, expected)
    return replace(
        registration,
        T_target_source=registration.T_target_source * RigidTransform.from_exp_coords((1 - share) * away),
        covariance=share * registration.covariance + (1 - share) * window + share * (1 - share) * np.outer(away, away),
        T_by_scans=None,
        covariance_by_scans=None,
    )


def _window(registration: Registration, expected: ExpectedPose) -> tuple[np.ndarray, np.ndarray]:
    """The step (6,) from a registration to where it was expected, and the (6, 6) covariance of that, in the axes of the
    registered source."""
    T_registered_expected = registration.T_target_source.inv() * expected.T_target_source
    away: np.ndarray = T_registered_expected.as_exp_coords()
    return away, rotated(T_registered_expected.rotation, expected.covariance)


def with_motion(pairs: Sequence[RegisteredPair], motion: AnyMotion) -> list[RegisteredPair]:
    """The pairs with what the motion says of their answers: where the scans leave a direction open, it holds the pose.

    Answers that the motion contradicts stay as they are: those that it does not draw to where the vehicle may go.
    """
    answers = [[] if p.registration is None else [p.registration, *p.registration.alternatives] for p in pairs]
    places = [(n, rank) for n, own in enumerate(answers) for rank in range(len(own))]
    if places:
        expected = [motion.expected(*pair.scans) for pair in pairs]
        lengths = [_known_length(motion.way(*pair.scans)) for pair in pairs]
        all_answers = [answers[n][rank] for n, rank in places]
        fused = _fused(all_answers, [expected[n] for n, _ in places], [lengths[n] for n, _ in places])
        for (n, rank), answer in zip(places, fused, strict=True):
            if not motion.contradicts(*pairs[n].scans, answer.T_target_source):
                answers[n][rank] = answer
    return [
        replace(pair, registration=replace(own[0], alternatives=tuple(own[1:]))) if own else pair
        for pair, own in zip(pairs, answers, strict=True)
    ]


def _known_length(length: tuple[float, float] | None) -> tuple[float, float]:
    """Mean and standard deviation of a length that holds a direction; NaN where it does not."""
    return (np.nan, np.nan) if length is None or length[0] < _UNDER_WAY * length[1] else length


def _fused(
    answers: Sequence[Registration], expected: Sequence[ExpectedPose], lengths: Sequence[tuple[float, float]]
) -> list[Registration]:
    """n answers as one measurement each with what was expected, and how far the vehicle goes."""
    T = RigidTransform.concatenate([answer.T_target_source for answer in answers])
    there: RigidTransform = T.inv() * RigidTransform.concatenate([each.T_target_source for each in expected])
    steps_there: np.ndarray = there.as_exp_coords()
    known = rotated(there.rotation, np.linalg.inv(np.stack([each.covariance for each in expected])))
    motion = _ExpectedSteps(steps_there, known, np.array(lengths))
    by_scans = np.linalg.inv(np.stack([answer.covariance for answer in answers]))
    covariances = np.linalg.inv(by_scans + known)
    steps = np.einsum("nab,nbc,nc->na", covariances, known, steps_there)
    _go_as_far(T, steps, covariances, by_scans, motion)
    covariances = (covariances + covariances.swapaxes(1, 2)) / 2
    moved = T * RigidTransform.from_exp_coords(steps)
    return [
        replace(
            answer,
            T_target_source=moved[n],
            covariance=covariances[n],
            T_by_scans=answer.T_target_source,
            covariance_by_scans=answer.covariance,
        )
        for n, answer in enumerate(answers)
    ]


@dataclass(frozen=True, slots=True)
class _ExpectedSteps:
    """What the motion expects of n poses: the steps to there (n, 6), the information that it has on them (n, 6, 6), and
    mean and standard deviation of the length of the way (n, 2) [m], NaN where it is not known."""

    steps: np.ndarray
    information: np.ndarray
    lengths: np.ndarray


def _go_as_far(
    T: RigidTransform, steps: np.ndarray, covariances: np.ndarray, by_scans: np.ndarray, motion: _ExpectedSteps
) -> None:
    """Change steps and covariances to where a step from T leads whose length is known, too.

    In the direction of the way, its length stands for what the motion tells otherwise: both were learned from the same.
    `by_scans` is the information that T has.
    """
    rows = np.flatnonzero(np.isfinite(motion.lengths[:, 0]))
    for _ in range(_ROUNDS):
        shift = (T[rows] * RigidTransform.from_exp_coords(steps[rows])).translation if len(rows) else np.zeros((0, 3))
        lengths = np.linalg.norm(shift, axis=1)
        moving = lengths >= 1e-9 * motion.lengths[rows, 0]
        rows, shift, lengths = rows[moving], shift[moving], lengths[moving]
        if not len(rows):
            return
        # what a step of the pose adds to the length
        along = np.zeros((len(rows), 6))
        along[:, 3:] = T[rows].rotation.inv().apply(shift / lengths[:, None])
        outer = along[:, :, None] * along[:, None, :]
        aside = np.eye(6) - outer
        rest = aside @ motion.information[rows] @ aside
        mean, precision = motion.lengths[rows, 0], motion.lengths[rows, 1] ** -2
        covariances[rows] = np.linalg.inv(by_scans[rows] + rest + outer * precision[:, None, None])
        missing = (mean - lengths + np.einsum("na,na->n", along, steps[rows])) * precision
        pull = np.einsum("nab,nb->na", rest, motion.steps[rows]) + along * missing[:, None]
        steps[rows] = np.einsum("nab,nb->na", covariances[rows], pull)


def _less(answer: Registration, left: float, pair: RegisteredPair, motion: AnyMotion | None) -> Registration:
    """An answer beside a better one: less probable by what the other leaves, and where the motion contradicts it."""
    if motion is not None and motion.contradicts(pair.i, pair.j, answer.T_target_source):
        left *= _CONTRADICTED
    return replace(answer, probability=left * answer.probability, accepted=False, alternatives=())
