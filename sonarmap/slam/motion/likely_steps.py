"""Odometry edges that are more probable than other pairs, as consecutive scans nearly always overlap."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.motion.measured_motion import AnyMotion
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.result import Registration

_STEP_ODDS = 2.5  # odds that consecutive scans overlap, over those of any pair


def with_likely_steps(pairs: Sequence[RegisteredPair], motion: AnyMotion | None) -> list[RegisteredPair]:
    """The pairs, with a higher probability of consecutive ones, which nearly always overlap.

    Those that are then likely are accepted; the usual motion widens covariances with an unconstrained direction.
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
    why = "likely enough for a step between consecutive scans"
    if registration.placed:
        why = "the usual motion constrains the direction that the scans do not"
    if not registration.is_fixed:
        if usual is None:
            return pair
        as_step = _either(as_step, usual.expected(*pair.scans), registration.probability)
    return replace(pair, registration=replace(as_step, accepted=True, reason=f"{why}; {registration.reason}"))


def _either(registration: Registration, expected: ExpectedPose, share: float) -> Registration:
    """Mean and covariance of a mixture of the registration, with weight `share`, and the expected pose."""
    away, window = expected.relative_to(registration.T_target_source)
    return replace(
        registration,
        T_target_source=registration.T_target_source * RigidTransform.from_exp_coords((1 - share) * away),
        covariance=share * registration.covariance + (1 - share) * window + share * (1 - share) * np.outer(away, away),
        T_by_scans=None,
        covariance_by_scans=None,
    )
