"""Use of the motion: for a second registration about the expected pose, and as a measurement beside registrations."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.known_pose import known_poses
from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.motion.measured_motion import AnyMotion
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.geometry import rotated
from sonarmap.spectral.result import Registration

_VARIANCE_FACTOR = 3.0  # of an expected pose over the marginal in the estimate (`slam.graph.pose_covariance`)
_ALL = 6  # directions of a pose that instruments measure, if all
_CONTRADICTED = 0.1  # factor of the probability of a hypothesis that the motion contradicts: vehicles do jump
_MIN_DISTANCE = 2.0  # that constrains the direction of motion [standard deviations]; at rest there is none
_ROUNDS = 5  # of updating the direction of motion


def is_doubtful(pair: RegisteredPair, motion: AnyMotion) -> bool:
    """Whether a pair is registered again: it was refused, the motion contradicts it, or with the motion another of its
    hypotheses is more probable."""
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
    """A pair with its second registration, about the expected pose, and with the hypotheses of the first one, by the
    scans alone, as alternatives; these are less probable if the motion contradicts them.

    Without a motion, an estimate gave the expected pose, and a wrong registration is near it too. The covariance then
    includes that of the expected pose, weighted by the probability of this. `with_motion` does so for the usual motion.
    """
    if first.registration is None or second.registration is None:
        return first
    retry = second.registration
    wrong = 1.0 - retry.probability
    remaining = wrong - sum(other.probability for other in retry.alternatives)
    hypotheses = (first.registration, *first.registration.alternatives)
    earlier = tuple(_lowered(each, remaining, first, motion) for each in hypotheses)
    if motion is None and second.expected is not None:
        away, window = second.expected.relative_to(retry.T_target_source)
        retry = replace(retry, covariance=retry.covariance + wrong * (window + np.outer(away, away)))
    return replace(second, registration=replace(retry, alternatives=(*retry.alternatives, *earlier)))


def without_unreachable(pair: RegisteredPair, motion: AnyMotion) -> RegisteredPair:
    """The pair of one survey without hypotheses that are out of the vehicle's reach."""
    registration = pair.registration
    if registration is None:
        return pair

    def reached(hypothesis: Registration) -> bool:
        return not motion.is_beyond(*pair.scans, hypothesis.T_target_source)

    alternatives = tuple(each for each in registration.alternatives if reached(each))
    if not reached(registration):
        reason = f"the vehicle cannot have come so far in the time between; {registration.reason}"
        registration = replace(registration, accepted=False, probability=0.0, reason=reason)
    return replace(pair, registration=replace(registration, alternatives=alternatives))


def expected_by(solution: Solution, pairs: Sequence[RegisteredPair], floor: np.ndarray) -> list[ExpectedPose]:
    """Poses that an estimate expects of pairs within a component, at least as certain as instruments alone measured
    them; `floor` (6,) is added to their sigmas [rad, m]."""
    T, covariances = solution.relatives(np.array([pair.scans for pair in pairs], np.intp).reshape(-1, 2))
    known = {each.pose: each for each in known_poses(dict(solution.graph.priors), solution.trajectory.T_world_sensor)}
    expected: list[ExpectedPose] = []
    for pair, T_i_j, covariance in zip(pairs, T, _VARIANCE_FACTOR * covariances, strict=True):
        ends = [known[k] for k in pair.scans if k in known and known[k].rank == _ALL]
        if len(ends) == 2:
            first, second = (np.linalg.inv(each.information) for each in ends)
            measured = propagated(T_i_j.inv(), first) + second
            covariance = min(covariance, measured, key=lambda each: np.trace(each[3:, 3:]))
        expected.append(ExpectedPose.of(T_i_j, covariance + np.diag(floor**2), len(ends) == 2))
    return expected


def with_motion(pairs: Sequence[RegisteredPair], motion: AnyMotion) -> list[RegisteredPair]:
    """The pairs with hypotheses combined with the motion, which constrains directions that the scans do not.

    A consecutive pair that was refused only for such a direction is then accepted: along a wall there may be no others.
    Hypotheses that contradict the motion even when combined with it stay unchanged.
    """
    hypotheses = [[] if p.registration is None else [p.registration, *p.registration.alternatives] for p in pairs]
    places = [(n, rank) for n, own in enumerate(hypotheses) for rank in range(len(own))]
    if places:
        expected = [motion.expected(*pair.scans) for pair in pairs]
        lengths = [_known_length(motion.way(*pair.scans)) for pair in pairs]
        chosen = [hypotheses[n][rank] for n, rank in places]
        fused = _fused(chosen, [expected[n] for n, _ in places], [lengths[n] for n, _ in places])
        for (n, rank), combined in zip(places, fused, strict=True):
            if not motion.contradicts(*pairs[n].scans, combined.T_target_source):
                is_step = rank == 0 and pairs[n].role == "sequential"
                hypotheses[n][rank] = _constrained(combined) if is_step else combined
    return [
        replace(pair, registration=replace(own[0], alternatives=tuple(own[1:]))) if own else pair
        for pair, own in zip(pairs, hypotheses, strict=True)
    ]


def _constrained(step: Registration) -> Registration:
    """A step combined with the motion: accepted if its place is, though a direction was unconstrained."""
    if step.accepted or step.is_fixed or not step.placed:
        return step
    reason = f"the usual motion constrains the direction that the scans do not; {step.reason}"
    return replace(step, accepted=True, reason=reason)


def _known_length(length: tuple[float, float] | None) -> tuple[float, float]:
    """Mean and standard deviation of a distance that constrains a direction; NaN if it does not."""
    return (np.nan, np.nan) if length is None or length[0] < _MIN_DISTANCE * length[1] else length


def _fused(
    hypotheses: Sequence[Registration], expected: Sequence[ExpectedPose], lengths: Sequence[tuple[float, float]]
) -> list[Registration]:
    """n hypotheses, each combined with its expected pose and distance."""
    T = RigidTransform.concatenate([each.T_target_source for each in hypotheses])
    there: RigidTransform = T.inv() * RigidTransform.concatenate([each.T_target_source for each in expected])
    steps_there: np.ndarray = there.as_exp_coords()
    known = rotated(there.rotation, np.linalg.inv(np.stack([each.covariance for each in expected])))
    motion = _ExpectedSteps(steps_there, known, np.array(lengths))
    by_scans = np.linalg.inv(np.stack([each.covariance for each in hypotheses]))
    covariances = np.linalg.inv(by_scans + known)
    steps = np.einsum("nab,nbc,nc->na", covariances, known, steps_there)
    _constrain_distances(T, steps, covariances, by_scans, motion)
    covariances = (covariances + covariances.swapaxes(1, 2)) / 2
    moved = T * RigidTransform.from_exp_coords(steps)
    return [
        replace(
            each,
            T_target_source=moved[n],
            covariance=covariances[n],
            T_by_scans=each.T_target_source,
            covariance_by_scans=each.covariance,
        )
        for n, each in enumerate(hypotheses)
    ]


@dataclass(frozen=True, slots=True)
class _ExpectedSteps:
    """Steps from n poses to those that the motion expects (n, 6), their information (n, 6, 6), and mean and standard
    deviation of the distance (n, 2) [m], NaN where unknown."""

    steps: np.ndarray
    information: np.ndarray
    lengths: np.ndarray


def _constrain_distances(
    T: RigidTransform, steps: np.ndarray, covariances: np.ndarray, by_scans: np.ndarray, motion: _ExpectedSteps
) -> None:
    """Change steps from T and covariances so that distances have the known lengths too.

    In the direction of motion, the length replaces the expected step, as both were learned from the same registrations.
    `by_scans` is the information of T.
    """
    rows = np.flatnonzero(np.isfinite(motion.lengths[:, 0]))
    for _ in range(_ROUNDS):
        shift = (T[rows] * RigidTransform.from_exp_coords(steps[rows])).translation if len(rows) else np.zeros((0, 3))
        lengths = np.linalg.norm(shift, axis=1)
        moving = lengths >= 1e-9 * motion.lengths[rows, 0]
        rows, shift, lengths = rows[moving], shift[moving], lengths[moving]
        if not len(rows):
            return
        # derivative of the length by a step of the pose
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


def _lowered(hypothesis: Registration, share: float, pair: RegisteredPair, motion: AnyMotion | None) -> Registration:
    """A hypothesis as alternative, with a share of its probability, and less if the motion contradicts it."""
    if motion is not None and motion.contradicts(pair.i, pair.j, hypothesis.T_target_source):
        share *= _CONTRADICTED
    return replace(hypothesis, probability=share * hypothesis.probability, accepted=False, alternatives=())
