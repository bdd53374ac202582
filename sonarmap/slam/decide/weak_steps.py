"""Weak odometry edges: doubtful consecutive pairs that no other pair confirms, as at the joint of two dives."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from sonarmap.slam.pair import RegisteredPair

_MIN_PROBABILITY = 0.95  # of a step that needs no confirmation
_MAX_SPAN = 5  # [scans] of pairs across a step that count as tried
_MIN_TRIED = 3  # pairs across a weak step
_MAX_SHARE = 1 / 3  # of weak steps; with more, other scans than consecutive ones overlap too little to confirm a step


def weak_steps(pairs: Sequence[RegisteredPair], free: bool = False) -> set[tuple[int, int]]:
    """The scans of weak steps: accepted with a low probability, with pairs across that were tried and none accepted.

    If `free`, pairs that were registered about the estimate do not confirm a step. The first and the last step are
    never weak, nor others with tried pairs on one side only: two dives do not meet there.
    """
    count = 1 + max((pair.j for pair in pairs), default=0)
    # differences along the steps of the numbers of tried pairs across a step, of those that begin before it, of those
    # that end after it, and of pairs that confirm it
    tried, before, behind, confirming = (np.zeros(count + 1, np.intp) for _ in range(4))
    for pair in pairs:
        if pair.role == "sequential" or pair.registration is None:
            continue
        if pair.j - pair.i <= _MAX_SPAN:
            _add(tried, pair.i, pair.j)
            _add(before, pair.i + 1, pair.j)
            _add(behind, pair.i, pair.j - 1)
        if pair.accepted and not (free and pair.expected is not None):
            _add(confirming, pair.i, pair.j)
    tried, before, behind, confirming = (np.cumsum(each) for each in (tried, before, behind, confirming))
    alone = (tried >= _MIN_TRIED) & (before > 0) & (behind > 0) & (confirming == 0)
    return {
        pair.scans
        for pair in pairs
        if pair.role == "sequential" and pair.registration is not None and pair.accepted
        if pair.registration.probability < _MIN_PROBABILITY and alone[pair.i]
    }


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
        reason = f"{probability}, and no pair across is accepted; {pair.registration.reason}"
        return replace(
            pair,
            registration=replace(pair.registration, accepted=False, probability=0.0, alternatives=(), reason=reason),
        )

    return [refused(pair) for pair in pairs]


def _add(changes: np.ndarray, first: int, end: int) -> None:
    """Add 1 from `first` to `end` - 1, as differences."""
    changes[first] += 1
    changes[end] -= 1
