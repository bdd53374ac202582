"""Manual constraints: the edges of pairs that a person decided about, and how strongly the others contradict them."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.pair import Pair, RegisteredPair
from sonarmap.slam.tie import Tie
from sonarmap.spectral.chi_squared import chi_squared
from sonarmap.spectral.result import Registration

CONTRADICTED = float(chi_squared(0.999, 6))  # chi-squared of a tie that the others contradict; of 1 in 1000 right ties


def hand_edges(
    pairs: Sequence[RegisteredPair],
    ties: Mapping[tuple[int, int], Tie],
    taken: Mapping[tuple[int, int], Registration],
) -> dict[tuple[int, int], Edge]:
    """The edges of the pairs that a person accepted or added, by their scans, even if others contradict them.

    A registration with alternatives contributes the hypothesis in `taken`, which the survey would use by itself, else
    the most probable one. Pairs without a registration, or with an invalid covariance, have no edge.
    """
    edges: dict[tuple[int, int], Edge] = {}
    for pair in pairs:
        tie = ties.get(pair.scans)
        if tie is None or tie.verdict == "reject" or pair.registration is None:
            continue
        chosen = taken.get(pair.scans, pair.registration) if tie.given is None else pair.registration
        kind = "tie" if tie.given is not None else "sequential" if pair.role == "sequential" else "loop"
        with suppress(InputError):  # the covariance is invalid; see `PossibleEdge.fault`
            edges[pair.scans] = Edge(pair.i, pair.j, chosen, kind, by_hand=True)
    return edges


def with_contradictions(pairs: Sequence[Pair], before: Solution) -> list[Pair]:
    """The pairs; those that are kept by hand have the chi-squared by which the rest contradicts them.

    It is the larger of those of their distances from the final poses and from `before`, the solution without what a
    person stated: for a wrong tie the graph may reject the right pairs.
    """
    by_hand = [pair for pair in pairs if pair.by_hand and pair.edge is not None and pair.registration is not None]
    stated = [_as_registered(pair) for pair in by_hand]
    scans = np.array([pair.scans for pair in by_hand], np.intp).reshape(-1, 2)
    distances = dict(zip((pair.scans for pair in by_hand), before.distances(scans, stated).tolist(), strict=True))
    return [
        replace(pair, contradicted=np.fmax(pair.residual, distances[pair.scans]) ** 2)
        if pair.scans in distances
        else pair
        for pair in pairs
    ]


def _as_registered(pair: Pair) -> Registration:
    """The registration of a pair's edge, with a covariance that contradictions did not enlarge."""
    assert pair.edge is not None
    assert pair.registration is not None
    return replace(pair.edge.registration, covariance=pair.registration.covariance)
