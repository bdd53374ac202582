"""Steps of a survey that no other pair confirms: where two dives meet over a bed of little relief, one may be found."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from sonarmap.slam.pair import RegisteredPair

# A step that is less probable is not sure; pairs across it are of scans no farther apart in time; and none of so many
# confirms it. Of 4,528 steps of 286 surveys eight right ones were so, in folders of two dives over beds, and nine by
# which two dives were joined.
_SURE, _NEAR, _TRIED = 0.95, 5, 3
# Where more of the steps are so, scans that do not follow each other share too little to say anything.
_FEW = 1 / 3


def lone_steps(pairs: Sequence[RegisteredPair], free: bool = False) -> set[tuple[int, int]]:
    """The scans of steps that are accepted and not sure, while no pair across is accepted, wherever it was looked for.

    If `free`, only what was found without the estimate counts as accepted. The first and the last step are none, nor
    others that pairs cross from one side alone: no two dives meet there.
    """
    count = 1 + max((pair.j for pair in pairs), default=0)
    # what begins or ends at each step; summed up, how many pairs are tried across it, how many of these from scans
    # before and to scans behind its own, and how many pairs confirm it
    tried, before, behind, found = (np.zeros(count + 1, np.intp) for _ in range(4))
    for pair in pairs:
        if pair.role == "sequential" or pair.registration is None:
            continue
        if pair.j - pair.i <= _NEAR:
            _add(tried, pair.i, pair.j)
            _add(before, pair.i + 1, pair.j)
            _add(behind, pair.i, pair.j - 1)
        if pair.accepted and not (free and pair.expected is not None):
            _add(found, pair.i, pair.j)
    tried, before, behind, found = (np.cumsum(each) for each in (tried, before, behind, found))
    alone = (tried >= _TRIED) & (before > 0) & (behind > 0) & (found == 0)
    return {
        pair.scans
        for pair in pairs
        if pair.role == "sequential" and pair.registration is not None and pair.accepted
        if pair.registration.probability < _SURE and alone[pair.i]
    }


def without_lone_steps(pairs: Sequence[RegisteredPair], told: Collection[tuple[int, int]]) -> Sequence[RegisteredPair]:
    """The pairs, lone steps not accepted, and without what was found across them where the estimate expected it.

    That the step is right is what such a pair was told. Not where many are so, nor where a person or dead reckoning has
    told something of the pair: then the scans are in `told`.
    """
    lone = lone_steps(pairs).difference(told)
    if not lone or len(lone) > max(1.0, _FEW * sum(pair.role == "sequential" for pair in pairs)):
        return pairs
    starts = np.array(sorted(i for i, _ in lone))

    def left(pair: RegisteredPair) -> RegisteredPair:
        crosses = np.searchsorted(starts, pair.i) < np.searchsorted(starts, pair.j)
        by_itself = pair.role != "sequential" and (pair.expected is None or pair.scans in told)
        if pair.registration is None or not crosses or by_itself:
            return pair
        said = f"right with a probability of {pair.registration.probability:.1%}"
        reason = f"{said}, and no pair across is accepted; {pair.registration.reason}"
        return replace(
            pair,
            registration=replace(pair.registration, accepted=False, probability=0.0, alternatives=(), reason=reason),
        )

    return [left(pair) for pair in pairs]


def _add(changes: np.ndarray, first: int, end: int) -> None:
    """One more from `first` on, up to but not at `end`."""
    changes[first] += 1
    changes[end] -= 1
