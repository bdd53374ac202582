"""Manual constraints: the edges of pairs that a person decided about, and how strongly the others contradict them."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.decide.contradiction import falls_without
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


def with_contradictions(pairs: Sequence[Pair], solution: Solution, before: Solution) -> list[Pair]:
    """The pairs; those that are kept manually have the chi-squared by which the rest contradicts them.

    It is the larger of two values for six numbers: the fall of the graph's chi-squared without the edge, and the
    distance from the solution without manual constraints (`before`). The graph alone would not show a wrong tie for
    which it rejected the right pairs. It is 0 if nothing else joins the scans.
    """
    edges = [edge for edge in solution.graph.edges if edge.by_hand]
    if not edges:
        return list(pairs)
    # with covariances as registered: those of the graph grow with its contradictions
    registered = {pair.scans: _as_registered(pair) for pair in pairs if pair.by_hand and pair.kept}
    scans = [(edge.i, edge.j) for edge in edges]
    distances = before.distances(np.array(scans), [registered[each] for each in scans])
    squared = np.maximum(falls_without(edges, solution), np.nan_to_num(distances) ** 2)
    by_scans = dict(zip(scans, squared.tolist(), strict=True))
    return [replace(pair, contradicted=by_scans.get(pair.scans, pair.contradicted)) for pair in pairs]


def displaced(pairs: Sequence[Pair], before: Sequence[Pair]) -> tuple[tuple[int, int], ...]:
    """The scans of pairs that are kept without manual constraints (`before`), and refused with them."""
    kept = {pair.scans for pair in before if pair.kept}
    return tuple(pair.scans for pair in pairs if pair.scans in kept and not pair.kept and pair.by_hand != "reject")


def _as_registered(pair: Pair) -> Registration:
    """The hypothesis of a pair's edge, as registered."""
    assert pair.edge is not None
    assert pair.registration is not None
    hypotheses = (pair.registration, *pair.registration.alternatives)
    taken = pair.edge.registration.T_target_source
    away: np.ndarray = (
        taken.inv() * RigidTransform.concatenate([each.T_target_source for each in hypotheses])
    ).as_exp_coords()
    return hypotheses[int(np.argmin(np.linalg.norm(away, axis=1)))]
