"""From everything that was registered to one estimate: which answers are taken, and why the others are not."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from kernels.errors import InputError
from slam.decide.consistency import chain_parts, find_support
from slam.decide.hypothesis import Hypothesis, hypotheses_of
from slam.decide.judged import Judged, Key
from slam.decide.robust import robust_optimize
from slam.decide.verdict import account
from slam.graph.edge import Edge, components, spanning_tree
from slam.graph.pose_graph import PoseGraph, Solution
from slam.graph.trajectory import Trajectory, chain
from slam.graph.world import place_in_world
from slam.loops.candidates import LoopSettings
from slam.pair import Pair, Trial
from spectral.scan import PosePrior

# Loops that a step of the chain outweighs: those that are given to the optimizer have been found consistent before.
_CHAIN_WORTH = 2.0
# What the optimizer grants each edge while it decides, as a share of the floor that a cycle is granted: errors that no
# covariance tells, such as of scans that are bent themselves. The more edges beyond a chain there are, the better they
# tell by themselves what is usual: so many halve its square.
_GRAPH_FLOOR, _TELLING = 0.2, 10


@dataclass(frozen=True, slots=True)
class Settlement:
    """What a survey's registrations amount to.

    Attributes:
        chained: N poses from the trusted edges alone, without a loop.
        solution: the optimized graph of what was taken.
        pairs: what became of every trial, in their order.
    """

    chained: Trajectory
    solution: Solution
    pairs: tuple[Pair, ...]


def settle(
    trials: Sequence[Trial],
    stamps: np.ndarray,
    priors: Mapping[int, PosePrior],
    voxel: float,
    settings: LoopSettings,
) -> Settlement:
    """Decide about every answer and optimize.

    Accepted registrations of consecutive scans are chained. All other answers, alternatives and refused ones among
    them, have to agree with the chain or with one another; those that join what the chain leaves apart come first. What
    is left is optimized robustly, so that an answer that the others contradict, one of the chain too, loses its say.

    Args:
        trials: every pair that was tried.
        stamps: (N,) float64 [s], of the scans.
        priors: what instruments say of the poses, by scan.
        voxel: edge of the survey's voxels [m].
        settings: how strictly answers are judged.
    """
    distrusted: set[Key] = set()
    while True:
        settled, blamed = _settle(trials, stamps, priors, settings.floor(voxel), settings.bound, distrusted)
        if not blamed:
            return settled
        distrusted |= blamed


def _settle(
    trials: Sequence[Trial],
    stamps: np.ndarray,
    priors: Mapping[int, PosePrior],
    floor: np.ndarray,
    bound: float,
    distrusted: Set[Key],
) -> tuple[Settlement, set[Key]]:
    """As `settle`, without the chain's pairs that are `distrusted`; and which others the optimizer found wrong."""
    count = len(stamps)
    trusted = [edge for trial in trials if (edge := _trusted(trial)) and (edge.i, edge.j) not in distrusted]
    chain_of = {(edge.i, edge.j) for edge in trusted}
    answers = [one for trial in trials if (trial.i, trial.j) not in chain_of for one in _answers(trial)]
    joins: list[Edge] = []
    while found := _joins(count, [*trusted, *joins], _judged(count, [*trusted, *joins], answers, floor, bound)):
        joins += found
    judged = _judged(count, [*trusted, *joins], answers, floor, bound)
    taken = _taken(judged)
    edges = (*trusted, *(one.hypothesis.edge() for one in taken.values()))
    parts = components(count, [*trusted, *joins])
    chained = place_in_world(chain([*trusted, *joins], stamps), parts, priors)
    graph = PoseGraph(chained, edges, priors=tuple(sorted(priors.items())))
    beyond = len(edges) - (count - len(parts))
    granted = _GRAPH_FLOOR * (1 + beyond / _TELLING) ** -0.5 * floor
    believed = robust_optimize(_widened(graph, granted), chain_worth=_CHAIN_WORTH)
    kept_graph = graph.keep(believed.accepted)
    solution = kept_graph.at(believed.solution.trajectory.T_world_sensor).optimize()
    solution = replace(solution, chi_squared_before=kept_graph.chi_squared)  # of the chained poses
    kept = {(edge.i, edge.j) for edge in solution.graph.edges}
    settled = Settlement(chained, solution, tuple(account(trials, judged, taken, solution)))
    return settled, chain_of - kept


def _widened(graph: PoseGraph, floor: np.ndarray) -> PoseGraph:
    """The graph with (6,) standard deviations added to each edge's."""
    edges = []
    for edge in graph.edges:
        covariance = edge.registration.covariance + np.diag(floor**2)
        edges.append(replace(edge, registration=replace(edge.registration, covariance=covariance)))
    return replace(graph, edges=tuple(edges))


def _judged(
    count: int, chained: Sequence[Edge], answers: Sequence[Hypothesis], floor: np.ndarray, bound: float
) -> list[Judged]:
    support = find_support(chain_parts(count, chained), answers, floor, bound)
    return [Judged(one, found) for one, found in zip(answers, support, strict=True)]


def _trusted(trial: Trial) -> Edge | None:
    """Consecutive scans whose registration is accepted are chained."""
    registration = trial.attempt.registration
    if trial.role != "sequential" or registration is None or not registration.accepted:
        return None
    try:
        return Edge(trial.i, trial.j, registration, "sequential")
    except InputError:
        return None


def _answers(trial: Trial) -> list[Hypothesis]:
    """The trial's answers that can be edges."""
    registration = trial.attempt.registration
    found = hypotheses_of(trial.i, trial.j, registration, trial.role != "loop") if registration else []
    return [one for one in found if not one.fault]


def _joins(count: int, trusted: Sequence[Edge], judged: Sequence[Judged]) -> list[Edge]:
    """Answers that join parts of the chain, as few as do, the best supported first."""
    joining = [one for one in judged if np.isnan(one.support.sigmas) and one.joins]
    joining.sort(key=lambda one: (-one.support.pairs, -one.hypothesis.weight, one.hypothesis.i, one.hypothesis.j))
    edges = [one.hypothesis.edge() for one in joining]
    tree = {id(edge) for edge in spanning_tree(count, [*trusted, *edges])}
    return [edge for edge in edges if id(edge) in tree]


def _taken(judged: Sequence[Judged]) -> dict[Key, Judged]:
    """At most one answer of every pair, that with more behind it."""
    taken: dict[Key, Judged] = {}
    for one in judged:
        key = (one.hypothesis.i, one.hypothesis.j)
        if one.joins if np.isnan(one.support.sigmas) else one.fits:
            taken[key] = max(taken.get(key, one), one, key=_standing)
    return taken


def _standing(one: Judged) -> tuple[bool, int, float]:
    return one.support.agrees, one.support.pairs, one.hypothesis.weight
