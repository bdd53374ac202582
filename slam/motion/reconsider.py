# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""What the motion adds to registrations: a second look about where it expects them, and a measurement beside them."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from slam.graph.edge import inverse_definite
from slam.graph.pose_graph import Solution
from slam.motion.measured_motion import AnyMotion
from slam.pair import Pair
from spectral.expected import ExpectedPose
from spectral.result import Registration

# Poses are less sure than the marginals of an estimate say: the variance over theirs (`slam.graph.pose_covariance`).
_UNSURE = 3.0
# What is left of an answer's probability where the motion contradicts it: vehicles do jump now and then.
_CONTRADICTED = 0.1
# How far a vehicle goes holds a direction where it is at least so many standard deviations; nearly at rest it has none.
_UNDER_WAY = 2.0
# The direction of the way is taken anew so often.
_ROUNDS = 5


def is_doubtful(pair: Pair, motion: AnyMotion) -> bool:
    """Whether a pair is worth another look: it was not accepted, or the motion contradicts what was."""
    registration = pair.registration
    if registration is None:
        return False
    return not registration.accepted or motion.contradicts(pair.i, pair.j, registration.T_target_source)


def with_both(first: Pair, second: Pair, motion: AnyMotion | None = None) -> Pair:
    """The pair with its second registration, and the first one's answers beside it.

    Args:
        first: registered by the scans alone.
        second: registered about where it is expected.
        motion: what it contradicts of the first answers is less probable.
    """
    if first.registration is None or second.registration is None:
        return first
    left = 1.0 - second.registration.probability
    answers = (first.registration, *first.registration.alternatives)
    earlier = tuple(_less(answer, left, first, motion) for answer in answers)
    return replace(
        first,
        expected=second.expected,
        registration=replace(second.registration, alternatives=(*second.registration.alternatives, *earlier)),
    )


def without_leaps(pair: Pair, motion: AnyMotion) -> Pair:
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


def expected_by(solution: Solution, pair: Pair, floor: np.ndarray) -> ExpectedPose:
    """Where an estimate of the poses expects a pair of one component; `floor` is (6,) granted beside [rad, m]."""
    T, covariance = solution.relative(*pair.scans)
    R = np.asarray(T.rotation.as_matrix())
    variances = [np.diag(R @ part @ R.T) for part in (covariance[:3, :3], covariance[3:, 3:])]
    return ExpectedPose.of(T, np.sqrt(_UNSURE * np.concatenate(variances) + floor**2))


def with_motion(pair: Pair, motion: AnyMotion) -> Pair:
    """The pair with what the motion says of its answers: where the scans leave a direction open, it holds the pose.

    Answers that the motion contradicts stay as they are.
    """
    registration = pair.registration
    if registration is None:
        return pair
    expected, way = motion.expected(*pair.scans), motion.way(*pair.scans)
    if way is not None and way[0] < _UNDER_WAY * way[1]:
        way = None

    def held(answer: Registration) -> Registration:
        T = answer.T_target_source
        return answer if motion.contradicts(pair.i, pair.j, T) else _fused(answer, expected, way)

    alternatives = tuple(held(answer) for answer in registration.alternatives)
    return replace(pair, registration=replace(held(registration), alternatives=alternatives))


def _fused(answer: Registration, expected: ExpectedPose, way: tuple[float, float] | None) -> Registration:
    """An answer as one measurement with what was expected, and how far the vehicle goes."""
    T = answer.T_target_source
    away: np.ndarray = (T.inv() * expected.T_target_source).as_exp_coords()
    # errors about and along the target's axes, in the source's
    turn: np.ndarray = np.kron(np.eye(2), np.asarray(T.rotation.as_matrix()).T)
    known: np.ndarray = turn @ np.diag(expected.sigmas**-2.0) @ turn.T
    by_scans = inverse_definite(answer.covariance)
    covariance = inverse_definite(by_scans + known)
    step: np.ndarray = covariance @ known @ away
    if way is not None:
        step, covariance = _as_far(T, step, by_scans, known, away, way)
    return replace(
        answer,
        T_target_source=T * RigidTransform.from_exp_coords(step),
        covariance=covariance,
        T_by_scans=T,
        covariance_by_scans=answer.covariance,
    )


def _as_far(
    T: RigidTransform,
    step: np.ndarray,
    by_scans: np.ndarray,
    known: np.ndarray,
    away: np.ndarray,
    way: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """(6,) where a step from T leads whose length is known, too, and its (6, 6) covariance.

    In the direction of the way, its length stands for what the motion tells otherwise: both were learned from the same.

    Args:
        step: (6,) without the length.
        by_scans: (6, 6) information that T has.
        known: (6, 6) information that the motion expects to be `away` (6,) from T.
        way: mean and standard deviation of the length [m].
    """
    mean, sigma = way
    covariance = inverse_definite(by_scans + known)
    for _ in range(_ROUNDS):
        shift: np.ndarray = (T * RigidTransform.from_exp_coords(step)).translation
        length = float(np.linalg.norm(shift))
        if length < 1e-9 * mean:
            break
        # what a step of the pose adds to the length
        along: np.ndarray = np.concatenate([np.zeros(3), T.rotation.inv().apply(shift / length)])
        aside = np.eye(6) - np.outer(along, along)
        rest = aside @ known @ aside
        covariance = inverse_definite(by_scans + rest + np.outer(along, along) / sigma**2)
        step = covariance @ (rest @ away + along * (mean - length + along @ step) / sigma**2)
    return step, covariance


def _less(answer: Registration, left: float, pair: Pair, motion: AnyMotion | None) -> Registration:
    """An answer beside a better one: less probable by what the other leaves, and where the motion contradicts it."""
    if motion is not None and motion.contradicts(pair.i, pair.j, answer.T_target_source):
        left *= _CONTRADICTED
    return replace(answer, probability=left * answer.probability, accepted=False, alternatives=())
