"""Pairs of which a person decided: what they contribute to the graph, and what the others say of it."""

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

# Chi-squared of six numbers that one right tie in a thousand exceeds: beyond it the others contradict a tie.
CONTRADICTED = float(chi_squared(0.999, 6))


def hand_edges(
    pairs: Sequence[RegisteredPair],
    ties: Mapping[tuple[int, int], Tie],
    taken: Mapping[tuple[int, int], Registration],
) -> dict[tuple[int, int], Edge]:
    """The edges of the pairs that a person accepted or added, by their scans, whatever the others say of them.

    Of a registration with alternatives it is the answer that the survey would take by itself, if it is among those
    `taken`; else the most probable. Pairs without a registration, or with one that cannot be an edge, have none.
    """
    edges: dict[tuple[int, int], Edge] = {}
    for pair in pairs:
        tie = ties.get(pair.scans)
        if tie is None or tie.verdict == "reject" or pair.registration is None:
            continue
        answer = taken.get(pair.scans, pair.registration) if tie.given is None else pair.registration
        kind = "tie" if tie.given is not None else "sequential" if pair.role == "sequential" else "loop"
        with suppress(InputError):  # its covariance is none; `fault` tells
            edges[pair.scans] = Edge(pair.i, pair.j, answer, kind, by_hand=True)
    return edges


def with_contradictions(pairs: Sequence[Pair], solution: Solution, before: Solution) -> list[Pair]:
    """The pairs, those that are kept by hand with how strongly the rest contradicts them.

    That is the larger of two chi-squared of six numbers: by how much that of the graph would fall without the edge, and
    how far it is from where the survey by itself has its scans. The graph alone would not show a wrong tie for which it
    gave up the right pairs. 0 where nothing else joins the scans. `before`: without a person's decisions.
    """
    edges = [edge for edge in solution.graph.edges if edge.by_hand]
    if not edges:
        return list(pairs)
    # as they were registered: how large the graph takes errors to be depends on what contradicts it
    registered = {pair.scans: _as_registered(pair) for pair in pairs if pair.by_hand and pair.kept}
    scans = [(edge.i, edge.j) for edge in edges]
    from_before = before.distances(np.array(scans), [registered[each] for each in scans])
    falls = np.maximum(falls_without(edges, solution), np.nan_to_num(from_before) ** 2)
    sizes = dict(zip(scans, falls.tolist(), strict=True))
    return [replace(pair, contradicted=sizes.get(pair.scans, pair.contradicted)) for pair in pairs]


def displaced(pairs: Sequence[Pair], before: Sequence[Pair]) -> tuple[tuple[int, int], ...]:
    """The scans of pairs that a survey keeps by itself (`before`), and refuses for what a person said of others."""
    kept = {pair.scans for pair in before if pair.kept}
    return tuple(pair.scans for pair in pairs if pair.scans in kept and not pair.kept and pair.by_hand != "reject")


def _as_registered(pair: Pair) -> Registration:
    """The answer that a pair's edge was made of."""
    assert pair.edge is not None
    assert pair.registration is not None
    answers = (pair.registration, *pair.registration.alternatives)
    taken = pair.edge.registration.T_target_source
    away: np.ndarray = (
        taken.inv() * RigidTransform.concatenate([answer.T_target_source for answer in answers])
    ).as_exp_coords()
    return answers[int(np.argmin(np.linalg.norm(away, axis=1)))]
