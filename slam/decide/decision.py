"""From everything that was registered to one estimate: which answers become edges, and why the others do not."""

from collections.abc import Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from kernels.errors import InputError
from slam.decide.chains import chain_parts
from slam.decide.consistency import compare
from slam.decide.navigation import Navigation
from slam.decide.possible_edge import PossibleEdge, possible_edges
from slam.decide.robust import robust_optimize
from slam.decide.twins import twin_odds, with_odds
from slam.decide.verdict import with_verdicts
from slam.decide.wrong_fixes import WrongFix, without_wrong_fixes
from slam.graph.edge import Edge, components, spanning_tree
from slam.graph.pose_covariance import weighed
from slam.graph.pose_graph import PoseGraph, Solution
from slam.graph.trajectory import Trajectory, chain
from slam.graph.world import place_in_world
from slam.loops.settings import LoopSettings
from slam.pair import Pair

# Loops that a step of the chain outweighs: those that are given to the optimizer have been found consistent before.
_CHAIN_WORTH = 2.0
# What the optimizer grants each edge while it decides, as a share of the floor that a cycle is granted: errors that no
# covariance knows, such as those of scans that are bent themselves. The more edges there are beyond a chain, the better
# they show by themselves what is usual: so many halve its square.
_GRAPH_FLOOR, _HALVING_EDGES = 0.2, 10
# So often a graph with priors is optimized again from its optimum: then it moves by less than a micrometer.
_SETTLING = 3


@dataclass(frozen=True, slots=True)
class Decision:
    """What a survey's registrations amount to.

    Attributes:
        chained: N poses from the trusted edges alone, without a loop.
        solution: the optimized graph of the edges that were kept.
        pairs: every pair with its verdict, in the order in which they were given.
        wrong_fixes: what instruments measured and all others contradict; it was left out.
    """

    chained: Trajectory
    solution: Solution
    pairs: tuple[Pair, ...]
    wrong_fixes: tuple[WrongFix, ...] = ()


def decide(
    pairs: Sequence[Pair],
    navigation: Navigation,
    voxel: float,
    settings: LoopSettings,
) -> Decision:
    """Decide about every answer of every pair, and optimize.

    Accepted registrations of consecutive scans are chained. All other answers, alternatives and refused ones among
    them, have to agree with the chain or with one another; those that join parts of the chain come first. What is left
    is optimized robustly, so that an answer that the others contradict, one of the chain too, is left out.

    Args:
        pairs: every pair that was tried.
        navigation: the scans, and what instruments say of their poses.
        voxel: edge of the survey's voxels [m].
        settings: how strictly answers are judged.
    """
    distrusted: set[tuple[int, int]] = set()
    while True:
        decision, contradicted = _decide(pairs, navigation, settings.floor(voxel), settings.bound, distrusted)
        if not contradicted:
            return decision
        distrusted |= contradicted


def _decide(
    pairs: Sequence[Pair],
    navigation: Navigation,
    floor: np.ndarray,
    bound: float,
    distrusted: Set[tuple[int, int]],
) -> tuple[Decision, set[tuple[int, int]]]:
    """As `decide` with `distrusted` pairs kept out of the chain; and which of the chain the graph contradicts."""
    count, stamps, odometry = len(navigation.scans), navigation.stamps, list(navigation.odometry)
    trusted = [edge for pair in pairs if pair.scans not in distrusted and (edge := _chain_edge(pair))]
    chain_scans = {(edge.i, edge.j) for edge in trusted}
    answers = [answer for pair in pairs if pair.scans not in chain_scans for answer in _answers(pair)]
    joins: list[Edge] = []
    compared = compare(chain_parts(count, [*trusted, *odometry]), answers, floor, bound)
    supported = compared.support(answers)
    if (odds := twin_odds(supported)) > 1:
        answers = with_odds(answers, odds)
        supported = compared.support(answers)
    while new_joins := _joins(count, [*trusted, *odometry, *joins], supported):
        joins += new_joins
        compared = compare(chain_parts(count, [*trusted, *odometry, *joins]), answers, floor, bound)
        supported = compared.support(answers)
    taken = _taken(supported)
    edges = (*trusted, *(possible.edge() for possible in taken.values()), *odometry)
    sure = [*trusted, *odometry, *joins]
    parts = components(count, sure)
    chained = place_in_world(chain(sure, stamps), parts, navigation.priors)
    fixes = PoseGraph(chained, tuple(sure))
    priors, wrong_fixes = without_wrong_fixes(_widened(fixes, _GRAPH_FLOOR * floor), navigation.priors)
    graph = PoseGraph(chained, edges, priors=tuple(sorted(priors.items())))
    beyond_chain = len(edges) - len(odometry) - (count - len(parts))
    granted = _GRAPH_FLOOR * (1 + beyond_chain / _HALVING_EDGES) ** -0.5 * floor
    robust = robust_optimize(_widened(graph, granted), chain_worth=_CHAIN_WORTH)
    optimum = robust.solution.trajectory.T_world_sensor
    kept_graph = weighed(graph.keep(robust.accepted).at(optimum))
    solution = kept_graph.optimize()
    for _ in range(_SETTLING if priors else 0):
        # what is not measured is taken from where the optimizer starts: let it be the optimum itself
        solution = solution.graph.optimize()
    before = kept_graph.at(chained.T_world_sensor).chi_squared
    solution = replace(solution, chi_squared_before=before)
    kept = {(edge.i, edge.j) for edge in solution.graph.edges if edge.is_registered}
    wrong = (*navigation.wrong_fixes, *wrong_fixes)
    decision = Decision(chained, solution, tuple(with_verdicts(pairs, supported, taken, solution)), wrong)
    return decision, chain_scans - kept


def _widened(graph: PoseGraph, floor: np.ndarray) -> PoseGraph:
    """The graph with (6,) standard deviations added to each registration's."""
    edges: list[Edge] = []
    for edge in graph.edges:
        if not edge.is_registered:
            edges.append(edge)
            continue
        covariance = edge.registration.covariance + np.diag(floor**2)
        widened = replace(edge.registration, covariance=covariance, T_by_scans=None, covariance_by_scans=None)
        edges.append(replace(edge, registration=widened))
    return replace(graph, edges=tuple(edges))


def _chain_edge(pair: Pair) -> Edge | None:
    """The pair's edge of the chain: of consecutive scans whose registration is accepted."""
    if pair.role != "sequential" or pair.registration is None or not pair.accepted:
        return None
    try:
        return Edge(pair.i, pair.j, pair.registration, "sequential")
    except InputError:
        return None


def _answers(pair: Pair) -> list[PossibleEdge]:
    """The pair's answers that can be edges."""
    return [possible for possible in possible_edges(pair) if not possible.fault]


def _joins(count: int, trusted: Sequence[Edge], supported: Sequence[PossibleEdge]) -> list[Edge]:
    """Answers that join parts of the chain, as few as suffice, the best supported first."""
    joining = [possible for possible in supported if possible.joins_parts and possible.may_join]
    joining.sort(key=lambda possible: (-possible.support.pairs, -possible.weight, *possible.scans))
    edges = [possible.edge() for possible in joining]
    tree = {id(edge) for edge in spanning_tree(count, [*trusted, *edges])}
    return [edge for edge in edges if id(edge) in tree]


def _taken(supported: Sequence[PossibleEdge]) -> dict[tuple[int, int], PossibleEdge]:
    """At most one answer of every pair, the best supported, by the pair's scans."""
    taken: dict[tuple[int, int], PossibleEdge] = {}
    for possible in supported:
        if possible.may_be_taken:
            taken[possible.scans] = max(taken.get(possible.scans, possible), possible, key=_standing)
    return taken


def _standing(possible: PossibleEdge) -> tuple[bool, int, float]:
    return possible.support.agrees, possible.support.pairs, possible.weight
