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
    expected = motion.expected(*pair.scans)

    def held(answer: Registration) -> Registration:
        T = answer.T_target_source
        return answer if motion.contradicts(pair.i, pair.j, T) else _fused(answer, expected)

    alternatives = tuple(held(answer) for answer in registration.alternatives)
    return replace(pair, registration=replace(held(registration), alternatives=alternatives))


def _fused(answer: Registration, expected: ExpectedPose) -> Registration:
    """An answer as one measurement with what was expected."""
    T = answer.T_target_source
    away: np.ndarray = (T.inv() * expected.T_target_source).as_exp_coords()
    # errors about and along the target's axes, in the source's
    turn: np.ndarray = np.kron(np.eye(2), np.asarray(T.rotation.as_matrix()).T)
    known: np.ndarray = turn @ np.diag(expected.sigmas**-2.0) @ turn.T
    covariance = inverse_definite(inverse_definite(answer.covariance) + known)
    step: np.ndarray = covariance @ known @ away
    return replace(
        answer,
        T_target_source=T * RigidTransform.from_exp_coords(step),
        covariance=covariance,
        T_by_scans=T,
        covariance_by_scans=answer.covariance,
    )


def _less(answer: Registration, left: float, pair: Pair, motion: AnyMotion | None) -> Registration:
    """An answer beside a better one: less probable by what the other leaves, and where the motion contradicts it."""
    if motion is not None and motion.contradicts(pair.i, pair.j, answer.T_target_source):
        left *= _CONTRADICTED
    return replace(answer, probability=left * answer.probability, accepted=False, alternatives=())
