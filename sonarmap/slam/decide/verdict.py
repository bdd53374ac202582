"""The verdict about every pair of a survey: whether it is kept, why, and its distance from the final poses."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace

import numpy as np

from sonarmap.slam.decide.possible_edge import PossibleEdge
from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.pair import Pair, RegisteredPair
from sonarmap.slam.tie import Tie
from sonarmap.spectral.chi_squared import chi_squared
from sonarmap.spectral.result import Registration

CONTRADICTED = float(chi_squared(0.999, 6))  # chi-squared of a tie that the others contradict; of 1 in 1000 right ties
_MANUAL = {"accept": "accepted", "add": "added", "given": "measured"}


def with_verdicts(
    pairs: Sequence[RegisteredPair],
    ties: Mapping[tuple[int, int], Tie],
    supported: Sequence[PossibleEdge],
    taken: Mapping[tuple[int, int], PossibleEdge],
    solution: Solution,
) -> list[Pair]:
    """Every pair with its edge, its reason and its distance from the final poses, in their order.

    `supported` are all hypotheses outside the chain, `taken` those that the optimizer got; the edges of the solution
    are kept.
    """
    kept = {(edge.i, edge.j): n for n, edge in enumerate(solution.graph.edges) if edge.is_of_pair}
    best = {possible.scans: possible for possible in reversed(supported)} | dict(taken)
    distances = _distances(pairs, best, kept, solution)
    decided: list[Pair] = []
    for pair in pairs:
        possible, n, tie = best.get(pair.scans), kept.get(pair.scans), ties.get(pair.scans)
        edge = None if n is None else solution.graph.edges[n]
        residual = distances.get(pair.scans, float("nan")) if n is None else float(solution.residuals[n])
        decided.append(
            Pair(
                **{field.name: getattr(pair, field.name) for field in fields(RegisteredPair)},
                edge=edge,
                reason=_reason(pair, tie, possible, pair.scans in taken, edge is not None, residual),
                agreeing=possible.support.pairs - 1 if possible else 0,
                sigmas_from_estimate=possible.support.sigmas if possible else float("nan"),
                residual=residual,
                by_hand=tie.by_hand if tie else "",
                note=tie.note if tie else "",
            )
        )
    return decided


def _distances(
    pairs: Sequence[RegisteredPair],
    best: Mapping[tuple[int, int], PossibleEdge],
    kept: Mapping[tuple[int, int], int],
    solution: Solution,
) -> dict[tuple[int, int], float]:
    """Distance of refused pairs from the final poses [sigmas]; NaN if their scans share no frame."""
    asked: dict[tuple[int, int], PossibleEdge] = {}
    for pair in pairs:
        if pair.scans not in kept and pair.registration is not None:
            possible = best.get(pair.scans) or PossibleEdge(pair.i, pair.j, pair.registration)
            if not possible.fault:
                asked[pair.scans] = possible
    scans = np.array(list(asked), np.intp).reshape(-1, 2)
    apart = solution.distances(scans, [possible.registration for possible in asked.values()])
    return dict(zip(asked, apart.tolist(), strict=True))


def _reason(
    pair: RegisteredPair, tie: Tie | None, possible: PossibleEdge | None, taken: bool, kept: bool, residual: float
) -> str:
    registration = pair.registration
    if tie and tie.verdict == "reject":
        return "rejected by hand"
    if registration is None:
        return f"failed: {pair.failure}"
    if tie and kept:
        return f"kept: {_MANUAL[tie.by_hand]} by hand, {residual:.1f} sigmas from the final poses"
    if possible is None:
        if fault := PossibleEdge(pair.i, pair.j, registration).fault:
            return f"failed: {fault}"
        if kept:
            return f"kept: {registration.reason or 'no reason given'}"
        if registration.accepted:
            return f"refused, inconsistent: the other pairs place the scans {residual:.1f} sigmas from there"
        return _refused(registration)
    if kept:
        return (
            f"kept: {_agreement(possible)}{_doubt(registration, possible)}, {residual:.1f} sigmas from the final poses"
        )
    if taken:
        return f"refused, inconsistent: the other pairs place the scans {residual:.1f} sigmas from there"
    if possible.support.elsewhere:
        return "refused: it leaves a direction unconstrained, and places the scans far from where the chain does"
    if registration.accepted:
        return f"refused, inconsistent: {_agreement(possible)}"
    return _refused(registration)


def _agreement(possible: PossibleEdge) -> str:
    """How far the chain and the other pairs agree with it."""
    support = possible.support
    others = f"{support.pairs - 1} other pairs agree with it" if support.pairs > 1 else "no other pair agrees with it"
    if possible.joins_parts:
        return f"{others} on the transform between two components"
    if support.agrees and support.pairs == 1:
        return f"the chain agrees with it to {support.sigmas:.1f} sigmas"
    return f"{others}, {support.sigmas:.1f} sigmas from the chain"


def _doubt(registration: Registration, possible: PossibleEdge) -> str:
    """Why it is kept though the registration did not accept it."""
    if possible.rank:
        return f", which is the registration's answer {possible.rank + 1} by probability"
    return "" if registration.accepted else f", though the registration was not sure ({registration.probability:.0%})"


def _refused(registration: Registration) -> str:
    return f"refused by the registration: {registration.reason or 'no reason given'}"


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
