"""Weak odometry edges: doubtful consecutive pairs that no other pair confirms, as at the joint of two dives."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sonarmap.slam.pair import RegisteredPair

_MIN_PROBABILITY = 0.95  # of a step that needs no confirmation
_MAX_SHARE = 1 / 3  # of weak steps; with more, other scans than consecutive ones overlap too little to confirm a step


@dataclass(frozen=True, slots=True)
class UnconfirmedStep:
    """A step (k, k + 1) with a low probability, without an accepted pair across that was registered freely."""

    pair: RegisteredPair
    # How many of (k - 1, k + 1) and (k, k + 2) are refused. Of all pairs across the step these overlap most: where two
    # dives meet, pairs about the estimate that relies on the joint can fit by chance, but rarely these two.
    refused: int


def unconfirmed_steps(pairs: Sequence[RegisteredPair]) -> list[UnconfirmedStep]:
    """The unconfirmed ones of all registered steps, in the order of the pairs."""
    registered = [pair for pair in pairs if pair.registration is not None]
    refused = {pair.scans for pair in registered if not pair.accepted}
    spanned = np.zeros(2 + max((pair.j for pair in registered), default=0), np.intp)  # differences along the steps
    for pair in registered:
        if pair.accepted and pair.role != "sequential" and pair.expected is None:
            spanned[pair.i] += 1
            spanned[pair.j] -= 1
    spanned = np.cumsum(spanned)
    return [
        UnconfirmedStep(pair, ((pair.i - 1, pair.j) in refused) + ((pair.i, pair.j + 1) in refused))
        for pair in registered
        if pair.role == "sequential" and not spanned[pair.i]
        if pair.registration is not None and pair.registration.probability < _MIN_PROBABILITY
    ]


def weak_steps(pairs: Sequence[RegisteredPair]) -> set[tuple[int, int]]:
    """The scans of weak steps: accepted, but unconfirmed, and both pairs beside them are refused."""
    return {step.pair.scans for step in unconfirmed_steps(pairs) if step.pair.accepted and step.refused == 2}


def without_weak_steps(pairs: Sequence[RegisteredPair], tied: Collection[tuple[int, int]]) -> Sequence[RegisteredPair]:
    """The pairs, with weak steps refused, and also the pairs across them that were registered about the estimate.

    The estimate about which such a pair was registered relies on the step. Pairs in `tied`, by dead reckoning or a
    person, are not refused, nor any pairs if many steps are weak.
    """
    weak = weak_steps(pairs).difference(tied)
    if not weak or len(weak) > max(1.0, _MAX_SHARE * sum(pair.role == "sequential" for pair in pairs)):
        return pairs
    starts = np.array(sorted(i for i, _ in weak))

    def refused(pair: RegisteredPair) -> RegisteredPair:
        crosses = np.searchsorted(starts, pair.i) < np.searchsorted(starts, pair.j)
        by_itself = pair.role != "sequential" and (pair.expected is None or pair.scans in tied)
        if pair.registration is None or not crosses or by_itself:
            return pair
        probability = f"right with a probability of {pair.registration.probability:.1%}"
        reason = f"{probability}, and the pairs beside it are refused; {pair.registration.reason}"
        return replace(
            pair,
            registration=replace(pair.registration, accepted=False, probability=0.0, alternatives=(), reason=reason),
        )

    return [refused(pair) for pair in pairs]
