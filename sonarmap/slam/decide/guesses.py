"""Steps that only the usual motion tells: which of them may join parts that no registration joins."""

from collections.abc import Sequence

import numpy as np
from scipy.cluster.hierarchy import DisjointSet

from sonarmap.slam.decide.chains import chain_parts
from sonarmap.slam.decide.consistency import distances_from_chain
from sonarmap.slam.decide.possible_edge import PossibleEdge
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.pair import RegisteredPair


def guessed_steps(count: int, known: Sequence[Edge], pairs: Sequence[RegisteredPair], bound: float) -> list[Edge]:
    """The guesses between parts of `count` scans that `known` edges do not join; as few as suffice.

    None where the known edges contradict half of the guesses elsewhere, beyond a bound [sigmas].
    """
    guesses = [Edge(pair.i, pair.j, pair.guess, "guess") for pair in pairs if pair.guess]
    chains = chain_parts(count, known)
    elsewhere = [guess for guess in guesses if chains.part[guess.i] == chains.part[guess.j]]
    if elsewhere and np.median(distances_from_chain(chains, elsewhere)) > bound:
        return []
    joined = DisjointSet(range(count))
    return [guess for guess in guesses if joined.merge(int(chains.part[guess.i]), int(chains.part[guess.j]))]


def uncontradicted(
    guesses: Sequence[Edge], before: Sequence[PossibleEdge], after: Sequence[PossibleEdge]
) -> list[Edge]:
    """The guesses that lead past no accepted answer which they contradict; answers with their support `before` and
    `after` the guesses joined parts."""
    against = [
        answer.scans
        for was, answer in zip(before, after, strict=True)
        if answer.accepted and was.joins_parts and not (answer.joins_parts or answer.support.agrees)
    ]
    return [guess for guess in guesses if not any(i <= guess.i < j for i, j in against)]
