# pyright: strict
"""How often places of a survey look like others: its loops show it, where the chain knows better."""

from collections.abc import Sequence
from dataclasses import replace

from sonarmap.slam.decide.possible_edge import PossibleEdge

# That registrations are wrong as often as they say counts like so many wrong ones.
_ASSUMED = 2.0


def twin_odds(possible_edges: Sequence[PossibleEdge]) -> float:
    """By how much more often than they say accepted registrations of this survey are wrong; at least 1.

    A probability is that of scenes of every kind. Where pillars, pools or pipes repeat themselves, registrations of
    scans of different places agree as well as right ones. What loops within a part say is known from its own chain.

    Args:
        possible_edges: all answers beside the chain, with their support.
    """
    judged = [possible for possible in possible_edges if possible.accepted and not possible.joins_parts]
    told = sum(1 - possible.probability for possible in judged)
    wrong = sum(not possible.support.agrees for possible in judged)
    return max(1.0, (wrong + _ASSUMED) / (told + _ASSUMED))


def with_odds(possible_edges: Sequence[PossibleEdge], odds: float) -> list[PossibleEdge]:
    """The same answers, so much more often wrong than their registrations say."""
    return [replace(possible, odds=odds) for possible in possible_edges]
